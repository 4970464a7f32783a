"""Robots that differ from the model: what is drawn, what it does to physics, packets and senses."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env import damage, hexapod
from srl_jax.env import variation as variations
from srl_jax.env.hexapod import SUBSTEPS, feel
from srl_jax.env.senses import NOISE
from srl_jax.env.settings import EnvConfig
from srl_jax.env.variation import LATENCY, RANGES, draw

STANCE, KEY = jnp.linspace(-0.5, 0.5, 18), jax.random.key(3)
MANY = jax.vmap(partial(draw, RANGES["wide"], STANCE))(jax.random.split(KEY, 500))
HEALTHY = damage.build("healthy")


def one(**changes):
    """A robot of the wide ranges with some of its numbers set."""
    own = draw(RANGES["wide"], STANCE, KEY)
    return own._replace(**{name: jnp.asarray(value, getattr(own, name).dtype) for name, value in changes.items()})


def moved(own, state, action):
    """After one control step; compiled once for all robots of a setting."""
    return _moved(tuple(own[:3]), state, action, setting=tuple(own[3:]))


@partial(jax.jit, static_argnames="setting")
def _moved(arrays, state, action, *, setting):
    return hexapod.step(hexapod.Hexapod(*arrays, *setting), HEALTHY, state, action)[0]


def robot(**settings):
    return hexapod.make("x", EnvConfig(**{"observation": "rates", "randomise": "wide"} | settings), 2.0)


@pytest.mark.parametrize("name", ["mass", "strength", "speed", "damping", "noise"])
def test_numbers_fill_their_range(name):
    low, high = getattr(RANGES["wide"], name)
    found = np.asarray(getattr(MANY, name))
    assert low <= found.min() < low + 0.1 * (high - low) and high - 0.1 * (high - low) < found.max() <= high


def test_latency_floor_and_slope_too():
    assert np.bincount(MANY.latency, minlength=LATENCY + 1).min() > 100
    assert 0.4 <= MANY.ground.friction.min() < MANY.ground.friction.max() <= 1.2
    np.testing.assert_allclose(np.linalg.norm(MANY.ground.down, axis=1), 1.0, rtol=1e-5)
    tilt = np.degrees(np.arccos(-np.asarray(MANY.ground.down[:, 2])))
    assert 4.5 < tilt.max() < 5.01 and np.ptp(np.arctan2(MANY.ground.down[:, 1], MANY.ground.down[:, 0])) > 6.0


def test_every_reset_draws_another_robot_and_none_draws_nothing():
    first, second = (hexapod.reset(robot(), HEALTHY, jax.random.key(n))[0] for n in (0, 1))
    assert first.variation.mass != second.variation.mass and first.variation.seed != second.variation.seed
    assert hexapod.reset(robot(randomise="none"), HEALTHY, KEY)[0].variation is None
    leaves = jax.tree.leaves(first.variation)
    assert variations.size(18) == sum(leaf.size for leaf in leaves)
    assert hexapod.state_size(robot().config) == sum(leaf.size for leaf in jax.tree.leaves(first))


@pytest.mark.parametrize("latency", [0, 1, 2])
def test_actions_come_late(latency):
    own = one(latency=latency, lost=0.0)
    for step in range(6):
        own = variations.sent(own, jnp.int32(step), jnp.full(18, float(step)))
        wanted = jnp.full(18, step - latency) if step >= latency else STANCE
        np.testing.assert_array_equal(own.held, wanted)


def test_a_servo_whose_packet_is_lost_keeps_its_target():
    own, kept = one(latency=0, lost=0.3), []
    for step in range(200):
        before, own = own, variations.sent(own, jnp.int32(step), jnp.full(18, float(step)))
        kept.append(np.asarray(own.held == before.held))
        assert set(np.unique(own.held[~kept[-1]])) <= {float(step)}
    assert 0.27 < np.mean(kept) < 0.33


def test_senses_are_as_bad_as_drawn_and_the_same_to_whoever_asks():
    state, _ = hexapod.reset(robot(), HEALTHY, KEY)
    true, own = feel(robot(), HEALTHY, state), one(noise=1.0, lost=0.1, bias=[0.5, 0, 0, 0, 0, 0])
    each = jax.vmap(lambda step: variations.read(own, step, true))(jnp.arange(2000))
    heard = np.asarray(each.answering)
    assert 0.88 < heard.mean() < 0.92 and (np.asarray(each.joints)[~heard] == 0.0).all()
    off = (np.asarray(each.joints) - np.asarray(true.joints))[heard]
    assert abs(off.std() - NOISE["joints"]) < 0.002 and abs(off.mean()) < 0.003
    gyroscope = np.asarray(each.gyroscope) - np.asarray(true.gyroscope)
    np.testing.assert_allclose(gyroscope.mean(axis=0), [0.5, 0.0, 0.0], atol=0.01)
    again = variations.read(own, jnp.int32(7), true)
    np.testing.assert_array_equal(again.joints, each.joints[7])


def test_observation_and_history_tell_of_the_same_readings():
    varied = robot(history=2)
    state, seen = hexapod.reset(varied, HEALTHY, KEY)
    np.testing.assert_array_equal(hexapod.sensed(varied, HEALTHY, state), seen[4 : 4 + 42])
    np.testing.assert_array_equal(hexapod.observe(varied, HEALTHY, state), seen)


def test_a_push_comes_now_and_then():
    own = one(push=0.2)
    pushed = jax.vmap(lambda step: variations.pushed(own, step, jnp.zeros(3)))(jnp.arange(4000))
    speed = np.linalg.norm(pushed, axis=1)
    assert 0.008 < np.mean(speed > 0) < 0.018 and (pushed[:, 2] == 0.0).all()
    np.testing.assert_allclose(speed[speed > 0], 0.2, rtol=1e-5)


def test_heavier_and_weaker_robots_are_those_of_a_changed_model():
    own = one(mass=1.2, strength=0.8, speed=0.5, damping=1.0)
    found, model = variations.body(HEALTHY, own), damage.damaged_model("healthy")
    model.body_mass[:] *= 1.2
    model.body_inertia[:] *= 1.2
    model.actuator_gainprm[:] *= 0.8
    model.actuator_forcerange[:] *= 0.8
    model.dof_damping[:] *= 2.0
    for name in ("body_mass", "body_inertia", "actuator_gainprm", "actuator_forcerange", "dof_damping"):
        np.testing.assert_allclose(getattr(found, name), getattr(model, name), rtol=1e-5, err_msg=name)


@pytest.mark.slow
def test_both_steppers_agree_on_another_floor():
    """Half a second of stepping from the stance on a slope that is slippery, heavy and weak."""
    actions = 0.6 * jax.random.uniform(KEY, (10, 18), minval=-1.0)
    ends = {}
    for name in ("star", "mjx"):
        own = robot(physics=name)
        state = hexapod.reset(own, HEALTHY, KEY)[0]
        for action in actions:
            state = moved(own, state, action)
        ends[name] = state
    np.testing.assert_allclose(ends["star"].qpos, ends["mjx"].qpos, atol=2e-4)
    assert SUBSTEPS == 3


@pytest.mark.parametrize(("tilt", "friction"), [(0.3, 0.2), (0.3, 1.2), (0.0, 0.2)])
def test_on_another_floor_it_moves_as_in_c_mujoco(tilt, friction):
    """Half a second of standing, or sliding down, on a floor that C MuJoCo is given by its own fields."""
    own, still = robot(start_noise=0.0), jnp.zeros(18)
    state = hexapod.reset(own, HEALTHY, KEY)[0]
    down = jnp.array([jnp.sin(tilt), 0.0, -jnp.cos(tilt)])
    plain = dict.fromkeys(("mass", "strength", "speed", "damping"), jnp.float32(1.0))
    quiet = dict.fromkeys(("push", "lost"), jnp.float32(0.0))
    ground = state.variation.ground._replace(friction=jnp.float32(friction), down=down)
    state = state._replace(variation=state.variation._replace(ground=ground, **plain, **quiet))
    model = damage.damaged_model("healthy")
    model.geom_friction[:, 0] *= friction
    model.opt.gravity[:] = np.linalg.norm(model.opt.gravity) * np.asarray(down)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = state.qpos, own.stance[7:]
    for _ in range(10):
        state = moved(own, state, still)
        mujoco.mj_step(model, data, SUBSTEPS)
    np.testing.assert_allclose(state.qpos, data.qpos, atol=1e-3)
    assert (data.qpos[0] > 0.02) == (tilt > 0 and friction < 0.3)


def test_unknown_words_are_refused_by_the_command_line(capsys):
    from srl_jax.cli import run

    with pytest.raises(SystemExit) as ended:
        run.parse(["--env.randomise", "heavy"])
    assert ended.value.code == 2 and "mild" in capsys.readouterr().err
    assert dataclasses.replace(EnvConfig(), randomise="mild").randomise in RANGES
