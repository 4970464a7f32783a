"""The quadruped that ships: its body, its damage, its physics by both steppers, and that it trots."""

from functools import partial

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env import damage, damage_names, gait, hexapod, interface, physics
from srl_jax.env.anatomy import PHANTOMX, QUADRUPED
from srl_jax.env.model import feet, load_model, stance
from srl_jax.env.settings import EnvConfig
from tests.env.star.reference import attempt, largest
from tests.env.walks import in_every_direction

STEPS = 120  # 2 s
EVERY_KIND = (
    *("healthy", "leg_rf", "thigh_rr", "shin_lf", "hip_lr:limp", "thigh_lf:locked=-20", "leg_rr:limp"),
    *("leg_lf:weak=0.5", "shin_rf:short=0.6", "shin_rf:locked+leg_lr", "leg_rf+leg_lr"),
)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return load_model(QUADRUPED)


# The body


def test_it_has_twelve_joints_leg_by_leg(model):
    assert QUADRUPED.joints[:4] == ("hip_rf", "thigh_rf", "shin_rf", "hip_rr")
    assert (model.nq, model.nv, model.nu, QUADRUPED.action_size) == (19, 18, 12, 12)
    assert model.body_mass.sum() == pytest.approx(1.678, abs=1e-3)


def test_it_stands_still_on_its_four_feet(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    own = feet(model, QUADRUPED)
    np.testing.assert_allclose(data.geom_xpos[own, 2], model.geom_size[own, 0], atol=1e-4)
    for _ in range(180):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos[:3], stance(model)[:3], atol=0.006)
    np.testing.assert_allclose(data.qpos[7:], stance(model)[7:], atol=0.1)
    assert np.abs(data.qvel).max() < 5e-3 and len(data.contact.geom1) == 4


def test_observations_have_its_sizes():
    parts = dict(interface.layout("x", "full", anatomy=QUADRUPED))
    assert parts["joint angles about the stance, rad"] == 12
    assert sum(parts.values()) == hexapod.observation_size("x", EnvConfig(), QUADRUPED) == 4 + 3 + 12 + 3 + 3 + 12 + 1
    facts = interface.facts("x", "onboard", 1.5, history=3, anatomy=QUADRUPED)
    assert facts["robot"] == "quadruped" and len(facts["action_scale"]) == 12
    assert facts["observation"][-1][1] == 3 * (3 + 12 + 12)


# Damage


def test_damages_are_named_after_its_parts():
    names = damage_names.catalogue(QUADRUPED)
    assert len(names) == len(set(names)) == 1 + 12 * 3 + 4 + 6
    assert all(damage_names.canonical(name, QUADRUPED) == name for name in names)
    assert damage_names.losses(QUADRUPED)[:3] == ("leg_rf", "thigh_rf", "shin_rf")
    assert damage_names.task_set("x", QUADRUPED) == ("shin_rf", "shin_rr", "shin_lf", "shin_lr")
    assert len(damage_names.parse_names("losses10", "x", QUADRUPED)) == 4 + 6


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("tibia_rf", "leg_, hip_, thigh_ or shin_ followed by one of rf, rr, lf, lr, joined with"),
        ("leg_rm", "unknown part 'leg_rm'"),
        ("thigh_rf:short=0.5", "unknown kind 'short' for thigh_rf; accepted are removed, limp, locked, weak=SHARE"),
        ("losses21", "unknown part 'losses21'"),
    ],
)
def test_what_it_has_not_is_refused_by_name(name, sentence):
    with pytest.raises(ValueError, match=sentence):
        damage_names.parse_names(name, "x", QUADRUPED)


def test_robots_do_not_know_each_others_parts():
    with pytest.raises(ValueError, match="coxa_, femur_ or tibia_ followed by one of rf, rm"):
        damage_names.canonical("shin_rf")
    assert damage_names.parse("leg_rf", QUADRUPED)[0].joints == ("hip_rf", "thigh_rf", "shin_rf")


@pytest.mark.parametrize("name", damage_names.catalogue(QUADRUPED))
def test_present_are_the_joints_that_the_recompiled_robot_has_or_that_are_locked(name):
    whole = damage.recompiled(name, QUADRUPED)
    own = {whole.joint(i).name for i in range(whole.njnt)}
    has = [joint in own or f"{joint}:locked" in name for joint in QUADRUPED.joints]
    np.testing.assert_array_equal(damage.present(damage.build(name, QUADRUPED)), has)


@pytest.mark.parametrize("name", EVERY_KIND)
def test_a_damaged_model_moves_as_the_recompiled_robot(name):
    masked, whole = damage.damaged_model(name, QUADRUPED), damage.recompiled(name, QUADRUPED)
    joints = [7 + QUADRUPED.joints.index(whole.joint(i).name) for i in range(1, whole.njnt)]
    paths = [swinging(masked), swinging(whole)]
    np.testing.assert_allclose(paths[0][:, :3], paths[1][:, :3], rtol=0, atol=1e-4)
    np.testing.assert_allclose(paths[0][:, joints], paths[1][:, 7:], rtol=0, atol=3e-3)
    assert np.ptp(paths[1][:, 7:], axis=0).max() > 0.2


def swinging(model: mujoco.MjModel) -> np.ndarray:
    """C MuJoCo from the stance, converged, under targets that swing, for the servos that there are: f[STEPS, nq]."""
    model.opt.iterations, model.opt.ls_iterations = 30, 30
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    locked = np.flatnonzero(model.dof_armature >= damage.LOCK_ARMATURE) + 1  # angles begin one later than freedoms
    data.qpos[locked] = model.qpos_spring[locked]
    columns = [QUADRUPED.joints.index(model.actuator(i).name) for i in range(model.nu)]
    start, path = stance(load_model(QUADRUPED))[7:], []
    for step in range(STEPS):
        swing = 0.2 * np.sin(0.1 * step + np.arange(12)) * min(1.0, step / 30)
        data.ctrl[:] = (start + swing)[columns]
        mujoco.mj_step(model, data)
        path.append(data.qpos.copy())
    return np.array(path)


# Physics and gait


def test_it_is_a_star_of_its_own():
    star = physics.choose("star", anatomy=QUADRUPED)
    assert star is not None and star.legs == 4 and star is physics.shipped_star(QUADRUPED)
    assert star is not physics.shipped_star() and physics.shipped_star() is physics.shipped_star(PHANTOMX)


@pytest.mark.slow
def test_both_steppers_move_it_alike(model):
    paths = attempt([mujoco.MjData(model)] * 64, spread=0.1).paths
    differences = largest(paths.single, paths.expected)
    assert differences.qpos.max() < 1e-13
    assert differences.qvel.max() < 1e-11


def test_a_damaged_one_is_observed_and_reset_as_it_is():
    robot = hexapod.make("x", EnvConfig(observation="onboard"), 1.5, QUADRUPED)
    values = damage.build("shin_rr+thigh_lf:locked=10", QUADRUPED)
    state, seen = hexapod.reset(robot, values, jax.random.key(0))
    assert seen.shape == (hexapod.observation_size("x", robot.config, QUADRUPED),)
    locked = 7 + QUADRUPED.joints.index("thigh_lf")
    np.testing.assert_allclose(state.qpos[locked], robot.stance[locked] + np.radians(10), atol=1e-6)
    assert seen[7 + QUADRUPED.joints.index("shin_rr")] == 0.0
    moved = hexapod.targets(robot, jnp.ones(12)) - robot.stance[7:]
    np.testing.assert_allclose(moved, np.tile([0.6, 0.7, 0.7], 4), atol=1e-6)


def test_diagonals_of_the_trot_are_in_antiphase():
    act, parameters = gait.walker(QUADRUPED), gait.load(QUADRUPED)
    clock = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    lift = lambda shift: np.array(  # noqa: E731
        [act(parameters, jnp.array([np.sin(x), np.cos(x), 0.0, 0.0])).reshape(4, 3)[:, 1] for x in clock + shift]
    )
    now, later = lift(0.0), lift(np.pi)
    np.testing.assert_allclose(now[:, [0, 1]], now[:, [3, 2]], atol=1e-5)  # rf with lr, rr with lf
    np.testing.assert_allclose(now[:, 0], later[:, 1], atol=1e-5)


def test_the_trot_walks_in_every_direction():
    parameters, act, healthy = gait.load(QUADRUPED), gait.walker(QUADRUPED), damage.build("healthy", QUADRUPED)
    robot = hexapod.make("p2p", EnvConfig(), float(parameters.frequency), QUADRUPED)
    path, fell, speed = in_every_direction(robot, healthy, partial(act, parameters))
    assert not np.any(fell)
    assert np.all(np.asarray(path)[..., 2] > 0.06)
    assert speed[0] >= 0.3 and np.all(speed >= 0.2)
