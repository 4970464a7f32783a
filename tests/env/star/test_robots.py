"""Other robots than the hexapod: a quadruped, and one whose limbs have nothing in common."""

import mujoco
import numpy as np
import pytest

from tests.env.star.reference import Trial, attempt, largest
from tests.env.star.robots import crab, quadruped

ROBOTS = 64


@pytest.fixture(
    scope="module", params=[quadruped, pytest.param(crab, marks=pytest.mark.slow)], ids=lambda make: make.__name__
)
def trial(request) -> Trial:
    """Robots whose masses, inertias, springs, servos and spheres differ by up to a tenth."""
    return attempt([mujoco.MjData(request.param())] * ROBOTS, spread=0.1)


def test_every_step_is_that_of_mjx(trial):
    differences = largest(trial.paths.single, trial.paths.expected)
    # Measured: 4e-15, 4e-13 and 5e-11.
    assert differences.qpos.max() < 1e-13
    assert differences.qvel.max() < 1e-11
    assert differences.warmstart.max() < 1e-9


def test_all_steps_together_are_those_of_mjx(trial):
    assert largest(trial.paths.free, trial.paths.expected).qpos.max() < 1e-10  # measured: 7e-13
    assert np.ptp(trial.paths.expected.qpos, axis=0)[:, 7:].max(0).min() > 0.1, "every joint moves"


def test_every_sphere_touches_and_every_limit_is_met(trial):
    data, spheres, limits = trial.robots[0], set(), set()
    for qpos in trial.paths.expected.qpos.reshape(-1, data.model.nq):
        data.qpos[:] = qpos
        mujoco.mj_forward(data.model, data)
        spheres.update(data.contact.geom2.tolist())
        limits.update(data.efc_id[data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT].tolist())
    assert spheres == set(np.flatnonzero(data.model.geom_contype))
    assert limits == set(np.flatnonzero(data.model.jnt_limited))
