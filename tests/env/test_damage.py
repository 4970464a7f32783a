"""Damage: a masked robot moves as one that truly lacks the limb, and each kind means what its name says.

A single Newton iteration, as in training, stops short of the solution, and the step it takes is not
continuous in the state: two runs that differ by 1e-7 can part by millimetres at a touch-down. So the
comparison of MJX with C converges the solver (30 iterations), where they agree to micrometres; one in C keeps
training's settings.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env import damage
from srl_jax.env.anatomy import JOINTS, LEGS
from srl_jax.env.model import feet, load_model, mjx, stance, step
from tests.env.reference import WALKING

STEPS = 120  # 2 s
STANDING = ("healthy", "tibia_rm", "femur_lf", "leg_rm", "leg_lr", "leg_rm+leg_lm")


def tripod() -> np.ndarray:
    """Targets of a gentle open-loop tripod gait at 20 Hz, held for three steps: f32[STEPS, 18] rad."""
    time = np.arange(STEPS) // 3 / 20
    targets = np.tile(stance(load_model())[7:], (STEPS, 1))
    ramp = np.minimum(time / 0.5, 1)
    for i, leg in enumerate(LEGS):
        phase = 2 * np.pi * 0.75 * time + (0 if leg in ("lf", "rm", "lr") else np.pi)
        targets[:, 3 * i] += 0.25 * ramp * np.sin(phase) * (1 if leg[0] == "r" else -1)
        targets[:, 3 * i + 1] += 0.25 * ramp * np.maximum(np.cos(phase), 0)
    return targets.astype(np.float32)


def standing() -> np.ndarray:
    return np.tile(stance(load_model())[7:], (STEPS, 1)).astype(np.float32)


def converge(model: mujoco.MjModel) -> mujoco.MjModel:
    model.opt.iterations, model.opt.ls_iterations = 30, 30
    return model


def rollout_c(model: mujoco.MjModel, targets: np.ndarray) -> np.ndarray:
    """C MuJoCo from the stance under the targets of the actuators ``model`` still has: f[STEPS, nq]."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    locked = np.flatnonzero(model.dof_armature >= damage.LOCK_ARMATURE) + 1  # angles begin one later than freedoms
    data.qpos[locked] = model.qpos_spring[locked]
    columns = [JOINTS.index(model.actuator(i).name) for i in range(model.nu)]
    path = []
    for target in targets:
        data.ctrl[:] = target[columns]
        mujoco.mj_step(model, data)
        path.append(data.qpos.copy())
    return np.array(path)


def assert_same_motion(masked, reference, model, *, position, angle, joint):
    """Compare f[STEPS, 25] with f[STEPS, nq] of the reduced ``model``, over what both have (m, rad, rad)."""
    joints = [7 + JOINTS.index(model.joint(i).name) for i in range(1, model.njnt)]
    np.testing.assert_allclose(masked[:, :3], reference[:, :3], rtol=0, atol=position)
    chord = np.minimum(
        np.linalg.norm(masked[:, 3:7] - reference[:, 3:7], axis=1),
        np.linalg.norm(masked[:, 3:7] + reference[:, 3:7], axis=1),
    )
    assert 2 * chord.max() < angle
    np.testing.assert_allclose(masked[:, joints], reference[:, 7:], rtol=0, atol=joint)


@pytest.fixture(scope="module")
def rollouts() -> tuple[dict, dict]:
    """The file's one compiled program: every damage walking, some standing; results by name.

    Walking: (qpos f32[STEPS, 25], actuator_force f32[STEPS, 18]). Standing: the last `mjx.Data`.
    """
    model = load_model()
    put = mjx.put_model(converge(model))
    pose = jnp.asarray(stance(model), jnp.float32)

    @jax.jit
    @jax.vmap
    def roll(values, targets):
        damaged = damage.apply(put, values)

        def advance(data, target):
            data = step(damaged, data.replace(ctrl=target))
            return data, (data.qpos, data.actuator_force)

        locked = jnp.append(False, damaged.dof_armature >= damage.LOCK_ARMATURE)
        start = jnp.where(locked, damaged.qpos_spring, pose)
        return jax.lax.scan(advance, mjx.make_data(damaged).replace(qpos=start), targets)

    targets = np.stack([tripod()] * len(WALKING) + [standing()] * len(STANDING))
    last, (path, force) = jax.device_get(roll(damage.stack((*WALKING, *STANDING)), targets))
    walking = {name: (path[i], force[i]) for i, name in enumerate(WALKING)}
    rows = {name: len(WALKING) + i for i, name in enumerate(STANDING)}
    return walking, {name: jax.tree.map(lambda leaf, i=i: leaf[i], last) for name, i in rows.items()}


# The same motion


@pytest.mark.parametrize("name", WALKING)
def test_masked_mjx_moves_as_the_recompiled_robot(rollouts, name):
    path, _ = rollouts[0][name]
    reference = damage.recompiled(name)
    # Measured: 3e-6 m, 3e-6 rad, 7e-6 rad; but 2e-4 m, 3e-3 rad, 1e-3 rad for leg_rf+leg_rm, which tips over.
    # The torso travels 0.15 m meanwhile.
    expected = rollout_c(converge(reference), tripod())
    assert_same_motion(path, expected, reference, position=1e-3, angle=1e-2, joint=5e-3)


@pytest.mark.parametrize("name", WALKING)
def test_masked_c_moves_as_the_recompiled_robot_with_training_settings(name):
    reference = damage.recompiled(name)
    path, expected = rollout_c(damage.damaged_model(name), tripod()), rollout_c(reference, tripod())
    # Measured: 2e-5 m, but 2.6 mm where one step differs (femur_lf:locked); see the top of the file.
    assert_same_motion(path, expected, reference, position=0.01, angle=0.05, joint=0.1)


@pytest.mark.parametrize("name", ["tibia_rm", "femur_rf", "leg_rm"])
def test_lost_links_that_spin_into_their_limits_do_not_move_the_robot(name):
    model = converge(damage.damaged_model(name))
    still, spinning = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, still, 0)
    mujoco.mj_resetDataKeyframe(model, spinning, 0)
    survivors = damage.recompiled(name)
    for joint in set(JOINTS) - {survivors.joint(i).name for i in range(survivors.njnt)}:
        spinning.joint(joint).qpos = model.joint(joint).range[1] + 0.1
        spinning.joint(joint).qvel = 30.0
    for target in tripod()[:60]:
        still.ctrl[:] = spinning.ctrl[:] = target
        mujoco.mj_step(model, still)
        mujoco.mj_step(model, spinning)
    np.testing.assert_allclose(spinning.qpos[:7], still.qpos[:7], rtol=0, atol=1e-3)


def test_everything_stays_finite(rollouts):
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(rollouts))


# What each kind means


@pytest.mark.parametrize("name", [name for name in WALKING if "limp" in name])
def test_limp_joints_carry_no_actuator_force(rollouts, name):
    path, force = rollouts[0][name]
    limp = [i for i, joint in enumerate(JOINTS) if f"{joint}:limp" in name or f"leg_{joint[-2:]}:limp" in name]
    assert limp
    np.testing.assert_array_equal(force[:, limp], 0)
    assert np.abs(path[-1, 7:] - stance(load_model())[7:])[limp].max() > 0.05  # and they do give way


@pytest.mark.parametrize("name", [name for name in WALKING if "locked" in name])
def test_locked_joints_do_not_move(rollouts, name):
    path, force = rollouts[0][name]
    locked = [i for i, joint in enumerate(JOINTS) if f"{joint}:locked" in name]
    angles = stance(load_model())[7:] + np.radians(-25 if name.endswith("=-25") else 0)
    assert np.abs(path[:, 7:] - angles)[:, locked].max() < 1e-4  # measured 1e-5 rad
    np.testing.assert_array_equal(force[:, locked], 0)


def test_a_weak_servo_gives_its_share_of_the_torque_and_no_more(rollouts):
    path, force = rollouts[0]["leg_rr:weak=0.5"]
    weak, healthy = [i for i, joint in enumerate(JOINTS) if joint.endswith("_rr")], load_model()
    gain, most = healthy.actuator_gainprm[0, 0], healthy.actuator_forcerange[0, 1]
    assert np.abs(force).max() > 0.8 * most, "others give more"
    assert np.abs(force[:, weak]).max() <= 0.5 * most + 1e-6
    push = 0.5 * gain * (tripod()[1:] - path[:-1, 7:])[:, weak]
    inside = np.abs(push) < 0.4 * most
    np.testing.assert_allclose(force[1:, weak][inside], push[inside], rtol=0, atol=0.1)


@pytest.mark.parametrize(("joint", "degrees"), [("coxa_rr", 0), ("femur_lm", 30), ("tibia_lf", -45)])
def test_a_joint_that_locks_in_motion_comes_to_its_angle(joint, degrees):
    model = damage.damaged_model(f"{joint}:locked={degrees}")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.joint(joint).qpos += 0.4
    data.joint(joint).qvel = 4.0
    for _ in range(120):
        mujoco.mj_step(model, data)
        assert 0.08 < data.qpos[2] < 0.13
    angle = stance(model)[model.joint(joint).qposadr[0]] + np.radians(degrees)
    assert data.joint(joint).qpos == pytest.approx(angle, abs=1e-4)


def test_a_shortened_leg_ends_nearer_to_its_knee():
    model = damage.damaged_model("tibia_lf:short=0.6")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    reach = np.linalg.norm(data.geom("foot_lf").xpos - data.body("tibia_lf").xpos)
    whole = np.linalg.norm(data.geom("foot_rf").xpos - data.body("tibia_rf").xpos)
    assert reach == pytest.approx(0.6 * whole)


@pytest.mark.parametrize("name", STANDING)
def test_lost_feet_bear_nothing_and_the_others_the_weight(rollouts, name):
    model = damage.damaged_model(name)
    data = rollouts[1][name]._impl  # `mjx.get_data` leaves parts of what C MuJoCo would ask for uninitialised
    lost = {geom for geom in feet(model) if model.geom_size[geom, 0] < 0}
    assert len(lost) == name.count("_")
    pressure = dict.fromkeys(range(model.ngeom), 0.0)
    for first, geom in zip(data.contact.efc_address, data.contact.geom2, strict=True):
        pressure[int(geom)] += float(data.efc_force[first : first + 4].sum())  # the edges of the friction's pyramid
    assert all(pressure[geom] == 0 for geom in lost)
    weight = 9.81 * damage.recompiled(name).body_mass.sum()
    assert sum(pressure.values()) == pytest.approx(weight, rel=0.01)
    if len(lost) < 2:
        assert all(pressure[geom] > 0.1 for geom in set(feet(model)) - lost)


@pytest.mark.parametrize(
    ("name", "mass"),
    [("healthy", 2.3), ("tibia_rm", 2.21), ("femur_rm", 2.185), ("leg_rm", 2.115), ("leg_rm+leg_lf", 1.93)],
)
def test_mass(name, mass):
    assert damage.recompiled(name).body_mass.sum() == pytest.approx(mass)
    assert damage.build(name).body_mass.sum() == pytest.approx(mass, abs=1e-4)
    assert damage.build(name).body_subtreemass[0] == pytest.approx(mass, abs=1e-4)
