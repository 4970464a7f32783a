"""Walking a gait: distance and foot contacts against C MuJoCo, and when a walk does not count."""

import subprocess
import sys

import jax
import mujoco
import numpy as np
import pytest

from srl_jax.env import damage, hexapod
from srl_jax.env.anatomy import LEGS
from srl_jax.env.model import feet, load_model, stance
from srl_jax.ite import archive, family, walk

RNG = np.random.default_rng(0)
GAITS = np.concatenate([family.REFERENCE[None], RNG.integers(0, 21, (5, 36)).astype(np.float32) / 20])
PARTS = walk.geometry()


def in_contact(model, qpos):
    """The geoms that touch the floor at a pose, as C MuJoCo finds them."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    return set(data.contact.geom.ravel()) - {model.geom("floor").id}, data


def walk_in_c(model, gait):
    """Distance (m), whether killed, and the contacts of each foot, all by C MuJoCo."""
    data, foot, start = mujoco.MjData(model), feet(model), stance(load_model())
    data.qpos[:] = start
    actions = np.asarray(family.table(gait))
    contacts, killed = np.zeros(6, int), False
    for step in range(100):
        data.ctrl[:] = start[7:] + np.tile([0.6, 0.7, 0.7], 6) * actions[5 * step % 100]
        mujoco.mj_step(model, data, hexapod.SUBSTEPS)
        touched, probe = in_contact(model, data.qpos)
        contacts += np.isin(foot, list(touched))
        killed |= bool(touched - set(foot)) or probe.body("torso").xmat[8] < hexapod.UPRIGHT
    return data.qpos[0], killed, contacts


@pytest.mark.parametrize("name", ["healthy", "leg_rm", "tibia_lf:limp"])
def test_distance_and_contacts_are_those_of_c_mujoco(walker, name):
    walked, model = walker(name, GAITS), damage.damaged_model(name)
    for index, gait in enumerate(GAITS):
        x, killed, contacts = walk_in_c(model, gait)
        assert killed == np.isneginf(walked.fitness[index])
        if not killed:
            np.testing.assert_allclose(walked.fitness[index], x, atol=2e-3)
        np.testing.assert_allclose(walked.contacts[index], contacts, atol=1)
    np.testing.assert_allclose(walked.descriptor, walked.contacts / 100, atol=1e-6)
    assert np.ptp(walked.contacts) > 30


def test_reference_walks_forward_and_with_its_sides_swapped_backward(walker):
    swapped = family.REFERENCE.reshape(6, 6)[[3, 4, 5, 0, 1, 2]].reshape(-1)
    forward, backward = walker("healthy", np.stack([family.REFERENCE, swapped])).fitness
    assert forward > 0.15 * 5.0 and backward < -0.15 * 5.0


def test_a_lost_foot_never_touches(walker):
    contacts = walker("leg_rm+leg_lf", GAITS).contacts
    lost = [LEGS.index("rm"), LEGS.index("lf")]
    assert not contacts[:, lost].any() and contacts.sum() > 0


def test_a_robot_on_its_belly_or_with_numbers_that_are_not_finite_is_killed(walker):
    assert np.isneginf(walker("leg_rf+leg_rm+leg_rr", GAITS).fitness).all()
    broken = GAITS.copy()
    broken[0, 0] = np.nan
    fitness = walker("healthy", broken).fitness
    assert np.isneginf(fitness[0]) and np.isfinite(fitness[1:]).all()


def test_a_gait_does_not_see_its_neighbours(walker):
    # Row 2 stays in its place: MJX is the same to the last bit at the same width only.
    others = RNG.uniform(size=(6, 36)).astype(np.float32)
    others[2] = GAITS[2]
    one, other = walker("healthy", GAITS), walker("healthy", others)
    assert one.fitness[2] == other.fitness[2] and one.fitness[3] != other.fitness[3]
    np.testing.assert_array_equal(one.contacts[2], other.contacts[2])


def test_feet_are_where_mujoco_has_them():
    model = load_model()
    for _ in range(20):
        qpos = np.concatenate([[0, 0, 0, 1, 0, 0, 0], RNG.uniform(-1.5, 1.5, 18)])
        _, data = in_contact(model, qpos)
        found = walk.foot_positions(PARTS, qpos[7:].astype(np.float32))
        np.testing.assert_allclose(found, data.geom_xpos[feet(model)], atol=1e-6)


def test_what_touches_is_what_mujoco_says():
    model, healthy = load_model(), damage.build("healthy")
    foot, seen = feet(model), []
    for _ in range(300):
        turn = np.concatenate([[1.0], RNG.normal(0.0, 0.2, 3)])
        qpos = stance(model)
        qpos[2], qpos[3:7] = RNG.uniform(0.02, 0.13), turn / np.linalg.norm(turn)
        qpos[7:] += RNG.uniform(-0.5, 0.5, 18)
        touched, _ = in_contact(model, qpos)
        feet_down, belly_down = walk.touching(PARTS, healthy, qpos.astype(np.float32))
        np.testing.assert_array_equal(feet_down, np.isin(foot, list(touched)))
        assert bool(belly_down) == bool(touched - set(foot))
        seen.append((int(feet_down.sum()), bool(belly_down)))
    assert {belly for _, belly in seen} == {False, True} and len({count for count, _ in seen}) > 4


@pytest.mark.slow
def test_a_real_search_keeps_what_its_gaits_walk(tmp_path):
    command = [sys.executable, "-m", "srl_jax.repertoire", "--evaluations", "20", "--batch", "16", "--devices", "2"]
    printed = subprocess.run([*command, "--out", str(tmp_path / "run")], capture_output=True, text=True, check=True)
    assert "32 gaits in" in printed.stdout and "cells filled" in printed.stdout
    found = archive.load(tmp_path / "run" / "map.npz")
    assert len(found.fitness) > 10
    # The search's own program: some gaits diverge on the rounding of another block size.
    walked = jax.jit(walk.make(walk.devices_mesh(2)))(damage.build("healthy"), found.gaits[:16])
    np.testing.assert_allclose(walked.fitness, found.fitness[:16], atol=2e-3)
    np.testing.assert_allclose(walked.descriptor, found.descriptors[:16], atol=0.011)
