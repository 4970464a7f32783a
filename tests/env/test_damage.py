"""Damage: names, values, and that a masked robot moves as one that truly lacks the limb.

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
from srl_jax.env.model import JOINTS, LEGS, feet, load_model, mjx, put_model, stance, step

STEPS = 120  # 2 s
WALKING = (
    "healthy",
    "tibia_rm",
    "tibia_rm:limp",
    "tibia_rm:locked",
    "femur_rf",
    "femur_lf:limp",
    "femur_lf:locked",
    "coxa_lm",
    "coxa_lr:limp",
    "coxa_lr:locked",
    "leg_rm",
    "leg_rm:limp",
    "leg_rf+leg_lr",
    "leg_rf+leg_rm",
    "tibia_rf:limp+leg_lm",
    "coxa_rm:locked+femur_rm:locked+tibia_rm:locked",
)
STANDING = ("healthy", "tibia_rm", "femur_lf", "leg_rm", "leg_lr", "leg_rm+leg_lm")

# Model leaves that follow the edits but enter no equation of motion here: drawing, broad phase, muscles.
NOT_PHYSICS = {
    *(".cam_poscom0", ".light_poscom0", ".geom_matid", ".geom_rgba"),
    *(".geom_aabb", ".geom_rbound", ".dof_M0", ".actuator_acc0"),
}


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
def healthy() -> mjx.Model:
    return put_model(load_model())


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

        return jax.lax.scan(advance, mjx.make_data(damaged).replace(qpos=pose), targets)

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
    assert np.abs(path[:, 7:] - stance(load_model())[7:])[:, locked].max() < 1e-4  # measured 1e-5 rad
    np.testing.assert_array_equal(force[:, locked], 0)


@pytest.mark.parametrize("joint", ["coxa_rr", "femur_lm", "tibia_lf"])
def test_a_joint_that_locks_in_motion_comes_to_its_stance_angle(joint):
    model = damage.damaged_model(f"{joint}:locked")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.joint(joint).qpos += 0.4
    data.joint(joint).qvel = 4.0
    for _ in range(120):
        mujoco.mj_step(model, data)
        assert 0.08 < data.qpos[2] < 0.13
    angle = stance(model)[model.joint(joint).qposadr[0]]
    assert data.joint(joint).qpos == pytest.approx(angle, abs=1e-4)


@pytest.mark.parametrize("name", STANDING)
def test_lost_feet_bear_nothing_and_the_others_the_weight(rollouts, name):
    model = damage.damaged_model(name)
    data = mjx.get_data(model, rollouts[1][name])
    lost = {geom for geom in feet(model) if model.geom_size[geom, 0] < 0}
    assert len(lost) == name.count("_")
    pressure = dict.fromkeys(range(model.ngeom), 0.0)
    for i, contact in enumerate(data.contact):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        pressure[contact.geom2] += wrench[0]
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


# Values


@pytest.mark.parametrize("name", WALKING)
def test_a_damage_holds_every_leaf_that_matters(healthy, name):
    applied = damage.apply(healthy, damage.build(name))
    expected = put_model(damage.damaged_model(name))
    for (path, leaf), other in zip(
        jax.tree_util.tree_leaves_with_path(applied), jax.tree.leaves(expected), strict=True
    ):
        if jax.tree_util.keystr(path) not in NOT_PHYSICS:
            np.testing.assert_array_equal(leaf, other, err_msg=jax.tree_util.keystr(path))


def test_apply_under_vmap_is_apply_one_by_one(healthy):
    batch = jax.device_get(jax.vmap(damage.apply, in_axes=(None, 0))(healthy, damage.stack(WALKING)))
    for i, name in enumerate(WALKING):
        one = jax.device_get(damage.apply(healthy, damage.build(name)))
        jax.tree.map(lambda leaf, alone, i=i: np.testing.assert_array_equal(leaf[i], alone), batch, one)


def test_every_value_of_the_catalogue_is_finite_and_has_one_shape():
    whole = damage.stack(damage.catalogue())
    for field, leaf in whole._asdict().items():
        assert leaf.dtype == np.float32, field
        assert leaf.shape == (82, *getattr(load_model(), field).shape), field
        assert np.isfinite(leaf).all(), field


def test_healthy_changes_nothing():
    model = load_model()
    for field, leaf in damage.build("healthy")._asdict().items():
        np.testing.assert_array_equal(leaf, getattr(model, field).astype(np.float32), err_msg=field)


def test_stack_needs_a_name():
    with pytest.raises(ValueError, match="at least one damage"):
        damage.stack(())


# Names


def test_catalogue_counts_and_round_trips():
    names = damage.catalogue()
    assert len(names) == len(set(names)) == 1 + 18 * 3 + 6 * 2 + 15
    assert tuple(damage.canonical(name) for name in names) == names
    assert names[:4] == ("healthy", "coxa_rf", "coxa_rf:limp", "coxa_rf:locked")
    assert len(damage.losses21()) == 21
    assert damage.losses21()[5:7] == ("leg_lr", "leg_rf+leg_rm")
    assert set(damage.losses21()) <= set(names)


@pytest.mark.parametrize(
    ("name", "canonical"),
    [
        ("healthy", "healthy"),
        ("tibia_rm:removed", "tibia_rm"),
        ("leg_lf + leg_rm:removed", "leg_rm+leg_lf"),
        ("leg_lm+tibia_rf:limp", "tibia_rf:limp+leg_lm"),
        ("tibia_rm:locked+coxa_rm:limp", "coxa_rm:limp+tibia_rm:locked"),
    ],
)
def test_canonical(name, canonical):
    assert damage.canonical(name) == canonical


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("", "unknown part ''; accepted are"),
        ("knee_rm", "unknown part 'knee_rm'; accepted are 'healthy' alone, or leg_, coxa_"),
        ("tibia_xx", "followed by one of rf, rm, rr, lf, lm, lr"),
        ("healthy+leg_rm", "unknown part 'healthy'; accepted are 'healthy' alone"),
        ("tibia_rm:bent", "unknown kind 'bent' for tibia_rm; accepted are removed, limp, locked"),
        ("tibia_rm:", "unknown kind '' for tibia_rm"),
        ("leg_rm:locked", "unknown kind 'locked' for leg_rm; accepted are removed, limp"),
        ("leg_rm+leg_rm", "names coxa_rm twice, by 'leg_rm' and 'leg_rm'"),
        ("leg_rm+tibia_rm:limp", "names tibia_rm twice, by 'leg_rm' and 'tibia_rm:limp'"),
        ("tibia_rm:locked+femur_rm", "names tibia_rm twice, by 'femur_rm' and 'tibia_rm:locked'"),
        ("tibia_rm:limp+tibia_rm", "names tibia_rm twice"),
    ],
)
def test_bad_names_are_refused_in_a_sentence(name, sentence):
    for function in (damage.canonical, damage.build, damage.recompiled):
        with pytest.raises(ValueError, match=r"^damage .*\.$") as error:
            function(name)
        assert sentence in str(error.value)


def test_sets_and_lists_for_the_command_line():
    assert damage.task_set("x") == tuple(f"tibia_{leg}" for leg in LEGS)
    assert damage.task_set("xy") == damage.task_set("p2p") == tuple(f"leg_{leg}" for leg in LEGS)
    assert damage.parse_names("task", "x") == damage.task_set("x")
    assert damage.parse_names("all", "x") == damage.catalogue()
    assert damage.parse_names("healthy, leg_lf+leg_rm", "x") == ("healthy", "leg_rm+leg_lf")
    with pytest.raises(ValueError, match="'leg_rm' more than once"):
        damage.parse_names("leg_rm,leg_rm:removed", "x")
    with pytest.raises(ValueError, match="task is 'walk'; accepted are x, xy, p2p"):
        damage.parse_names("task", "walk")
