"""Robots to recover on differ from the atlas' own in the ways that their worlds say."""

import jax
import numpy as np
import pytest

from srl_jax.atlas.robots import CRobot, GoalRobot, MjxRobot, World
from srl_jax.env import gait
from srl_jax.env.senses import NOISE, observation
from srl_jax.env.settings import EnvConfig

STILL = np.zeros(18)
UP = np.tile([0.0, 0.5, 0.0], 6)


def quiet(**fields):
    return World(noise=0.0, **fields)


def walked(world, steps=6, action=STILL):
    body = CRobot("healthy", 1_000, world=world)
    body.reset()
    return body, [body.step(action) for _ in range(steps)]


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_an_action_is_taken_so_many_steps_later(delay):
    _, moving = walked(quiet(delay=delay), action=UP)
    _, still = walked(quiet())
    differs = [bool(np.abs(a.joints - b.joints).max() > 0.01) for a, b in zip(moving, still, strict=True)]
    assert differs.index(True) == delay


def test_packets_are_lost_in_both_directions():
    body, senses = walked(quiet(lost=0.2), steps=60, action=UP)
    silent = np.array([~felt.answering for felt in senses])
    assert abs(silent.mean() - 0.2) < 0.04 and silent.any(axis=0).all(), "every servo's, now and then"
    assert all(np.all(felt.joints[~felt.answering] == 0.0) for felt in senses)
    first = CRobot("healthy", 1_000, world=quiet(lost=0.9))
    first.reset()
    first.step(UP)
    commanded = np.isclose(first._data.ctrl, first._stance[7:] + first._scale * UP) & (UP != 0.0)
    assert 0 <= commanded.sum() <= 3, "of six femurs that should rise, few are told"
    assert len(body.positions) == 60


def test_a_slope_and_a_payload_are_felt():
    _, senses = walked(quiet(slope=5.0), steps=20)
    np.testing.assert_allclose(senses[-1].gravity, [-np.sin(np.radians(5)), 0, -np.cos(np.radians(5))], atol=0.03)
    light, _ = walked(quiet(), steps=20)
    heavy, _ = walked(quiet(payload=0.5), steps=20)
    assert heavy._models[0].body_mass.sum() == pytest.approx(light._models[0].body_mass.sum() + 0.5)
    assert heavy.positions[-1][2] < light.positions[-1][2]


def test_a_bias_is_the_same_all_along_and_encoders_tell_so_many_degrees_apart():
    _, true = walked(quiet(), steps=8)
    _, biased = walked(quiet(bias=3.0, encoder=0.5), steps=8)
    off = np.array([b.gravity - a.gravity for a, b in zip(true, biased, strict=True)])
    assert np.ptp(off, axis=0).max() < 1e-3 and np.abs(off).max() > NOISE["gravity"]
    told = np.degrees(biased[-1].joints) / 0.5
    np.testing.assert_allclose(told, np.round(told), atol=1e-3)
    assert np.abs(biased[-1].joints - true[-1].joints).max() <= np.radians(0.26)


def test_mass_and_servos_are_shares_of_the_models():
    body, _ = walked(quiet(mass=1.2, gain=0.7, friction=0.5))
    plain, _ = walked(quiet(friction=1.0))
    own, other = body._models[0], plain._models[0]
    np.testing.assert_allclose(own.body_mass, 1.2 * other.body_mass)
    np.testing.assert_allclose(own.actuator_gainprm[:, 0], 0.7 * other.actuator_gainprm[:, 0])
    np.testing.assert_allclose(own.geom_friction[:, 0], 0.5 * other.geom_friction[:, 0])


@pytest.mark.parametrize("make", [CRobot, MjxRobot])
def test_damage_strikes_in_mid_stride_and_not_before(make):
    body = make("leg_rm", 3)
    assert body.reset().answering.all()
    answering = [body.step(STILL).answering for _ in range(5)]
    assert [bool(now.all()) for now in answering] == [True, True, True, False, False]
    assert np.flatnonzero(~answering[-1]).tolist() == [3, 4, 5] and len(body.positions) == 5 and not body.fell
    again = make("leg_rm", 3)
    again.reset()
    np.testing.assert_array_equal(again.step(STILL).joints, make_first(make))


def make_first(make):
    body = make("leg_rm", 3)
    body.reset()
    return body.step(STILL).joints


def test_a_robot_walks_from_goal_to_goal_and_what_it_comes_towards_them_adds_up():
    act, tripod = jax.jit(gait.act), gait.load()
    body, goals = GoalRobot("healthy", 1_000, world=quiet()), []
    senses, low, high = body.reset(), *EnvConfig().goal_ring
    for step in range(200):
        away, frame = body._goal - body._data.qpos[:2], body._frame()
        heading = frame[:2, 0] / np.linalg.norm(frame[:2, 0])
        turned = np.array([[heading[0], -heading[1]], [heading[1], heading[0]]]) @ senses.towards
        assert senses.distance == pytest.approx(np.linalg.norm(away), abs=1e-5)
        np.testing.assert_allclose(turned, away / np.linalg.norm(away), atol=1e-5)
        goals.append(body._goal.copy())
        shown = observation(senses, np.float32(step * 2.1358 / 20 % 1), task="p2p", kind="onboard", xp=np)
        senses = body.step(np.asarray(act(tripod, shown)))
    changed = [step for step in range(1, 200) if (goals[step] != goals[step - 1]).any()]
    assert body.reached == len(changed) >= 2
    apart = [np.linalg.norm(goals[b] - goals[a]) for a, b in zip([0, *changed], changed, strict=False)]
    assert low - 0.2 < min(apart) and max(apart) < high + 0.2
    assert np.abs(np.diff(body.come)).max() < 0.06, "nothing is won by a new goal"
    assert body.come[-1] > 2 * (low - EnvConfig().goal_radius)
    again = GoalRobot("healthy", 1_000, world=quiet())
    assert again.reset().distance != GoalRobot("healthy", 0, 1).reset().distance and (again._goal == goals[0]).all()
