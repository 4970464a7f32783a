"""The healthy robot: what it weighs, how its parts are called, that it stands."""

import jax
import mujoco
import numpy as np
import pytest

from srl_jax.env.anatomy import JOINTS, LEGS, SEGMENTS
from srl_jax.env.model import (
    feet,
    forward,
    load_model,
    load_spec,
    mjx,
    put_model,
    stance,
    step,
    xml_path,
)
from tests.env.reference import products


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return load_model()


def at_stance(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stance").id)
    mujoco.mj_forward(model, data)
    return data


def test_sizes_and_total_mass(model):
    assert (model.nq, model.nv, model.nu, model.nbody) == (25, 24, 18, 20)
    assert model.body_mass.sum() == pytest.approx(2.3, abs=1e-9)
    assert (model.body_inertia[1:] > 0).all()


def test_joints_and_actuators_come_leg_by_leg(model):
    assert JOINTS[:4] == ("coxa_rf", "femur_rf", "tibia_rf", "coxa_rm")
    assert tuple(model.joint(i).name for i in range(model.njnt)) == ("root", *JOINTS)
    assert tuple(model.actuator(i).name for i in range(model.nu)) == JOINTS
    np.testing.assert_array_equal(model.actuator_trnid[:, 0], np.arange(1, 19))
    np.testing.assert_array_equal(model.actuator_ctrlrange, model.jnt_range[1:])
    np.testing.assert_allclose(np.rad2deg(model.jnt_range[1:4, 1]), [75, 100, 150])


def test_servos_have_the_datasheets_torque_and_speed(model):
    np.testing.assert_array_equal(model.actuator_forcerange, np.tile([-1.5, 1.5], (18, 1)))
    np.testing.assert_allclose(1.5 / model.dof_damping[6:], 6.18, rtol=2e-3)


def test_segments_have_the_kits_lengths(model):
    for leg in LEGS:
        hip, knee = model.body(f"femur_{leg}").pos, model.body(f"tibia_{leg}").pos
        foot = model.geom(f"foot_{leg}").pos
        np.testing.assert_allclose([hip, knee, foot], [[0.053, 0, 0], [0.066, 0, 0], [0.131, 0, 0]])


@pytest.mark.parametrize("leg", LEGS)
def test_legs_point_outwards_and_positive_pitch_lifts(model, leg):
    data = mujoco.MjData(model)  # every joint at 0
    foot = model.geom(f"foot_{leg}").id
    mujoco.mj_forward(model, data)
    stretched = data.geom_xpos[foot].copy()
    hip = data.body(f"coxa_{leg}").xpos
    assert np.linalg.norm(stretched - hip) == pytest.approx(0.25)
    assert np.dot(stretched[:2] - hip[:2], hip[:2]) > 0
    assert np.sign(stretched[1]) == (1 if leg[0] == "l" else -1)
    for segment in SEGMENTS[1:]:
        data.qpos[:] = model.qpos0
        data.joint(f"{segment}_{leg}").qpos = 0.3
        mujoco.mj_forward(model, data)
        assert data.geom_xpos[foot, 2] > stretched[2] + 0.03


def test_stance_puts_the_feet_on_the_floor(model):
    data = at_stance(model)
    np.testing.assert_allclose(data.geom_xpos[feet(model), 2], model.geom_size[feet(model), 0], atol=1e-4)
    for leg in LEGS:
        out = data.geom(f"foot_{leg}").xpos - data.body(f"coxa_{leg}").xpos
        assert np.linalg.norm(out[:2]) == pytest.approx(0.16, abs=1e-3)
    np.testing.assert_array_equal(data.ctrl, stance(model)[7:])
    assert 0.09 < stance(model)[2] < 0.12


def test_stance_stands_still(model):
    data = at_stance(model)
    for _ in range(180):
        mujoco.mj_step(model, data)
    # The servos are compliant: 12 N m/rad under a leg's share of the weight give some hundredths of a radian.
    np.testing.assert_allclose(data.qpos[:3], stance(model)[:3], atol=0.006)
    np.testing.assert_allclose(data.qpos[7:], stance(model)[7:], atol=0.05)
    assert np.abs(data.qvel).max() < 5e-3
    assert np.abs(data.actuator_force).max() < 0.75


def test_only_feet_and_belly_touch_and_only_the_floor(model):
    floor = model.geom("floor").id
    touching = {
        model.geom(i).name
        for i in range(model.ngeom)
        if model.geom_contype[i] & model.geom_conaffinity[floor] and i != floor
    }
    assert touching == {f"foot_{leg}" for leg in LEGS} | {f"belly_{leg}" for leg in ("rf", "rr", "lf", "lr")}
    assert (model.geom_conaffinity[np.arange(model.ngeom) != floor] == 0).all()
    assert (model.geom_condim == 3).all()


def test_folded_robot_rests_on_its_belly(model):
    data = mujoco.MjData(model)
    data.qpos[:] = stance(model)
    data.joint("root").qpos[2] = 0.06
    data.qpos[8::3], data.ctrl[1::3] = 1.3, 1.3
    for _ in range(180):
        mujoco.mj_step(model, data)
    assert 0.035 < data.qpos[2] < 0.041  # the belly spheres end 40 mm below the middle of the torso


def test_mjx_takes_the_model(model):
    put = put_model(model)
    assert (put.nq, put.nv, put.nu) == (25, 24, 18)
    assert put.opt.iterations == 2
    assert put.opt.ls_iterations == 4
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(put))


@pytest.mark.parametrize("function", [step, forward])
def test_physics_multiplies_at_full_precision_on_every_device(model, function):
    found = products(function, put_model(model), mjx.make_data(model))
    assert len(found) > 10 and all("HIGHEST, HIGHEST" in line for line in found)


def test_each_load_is_a_fresh_copy():
    first = load_model()
    first.body_mass[:] = 0
    assert load_model().body_mass.sum() == pytest.approx(2.3)
    assert load_spec().compile().nq == 25
    assert xml_path().name == "phantomx.xml"
