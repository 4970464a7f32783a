"""Inertia, bias and servo forces of a pose, against C MuJoCo."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env.model import load_model
from srl_jax.env.star import arrow, dynamics, kinematics
from srl_jax.env.star.arrow import Motion
from srl_jax.env.star.body import Body, body, by_id, by_link
from srl_jax.env.star.constants import FILLER, Star, read
from tests.env.star.reference import states
from tests.env.star.robots import crab, hopper, quadruped

ROBOTS = 4


def plain(tree):
    """In place of a seam."""
    return tree


class Posed:
    """Robots in random states, for C MuJoCo and for the stepper, in f64."""

    def __init__(self, model: mujoco.MjModel):
        self.model, (self.state, targets) = model, states(model, ROBOTS)
        self.data = [mujoco.MjData(model) for _ in range(ROBOTS)]
        for data, qpos, qvel, control in zip(self.data, self.state.qpos, self.state.qvel, targets[0], strict=True):
            data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, control
            mujoco.mj_forward(model, data)
        self.star: Star = read(model)
        self.ids = self.star.ids
        self.body: Body = jax.tree.map(lambda x: jnp.stack([x] * ROBOTS, -1), body(self.star, model))
        qpos, qvel = self.state.qpos.T, self.state.qvel.T
        self.joints = list(by_link(jnp.asarray(qpos), self.ids.qpos))
        self.targets = list(by_link(jnp.asarray(targets[0].T), self.ids.actuator))
        self.standing = kinematics.attitude(list(jnp.asarray(qpos[3:7])), plain)
        self.legs = kinematics.legs(self.star, self.body, self.joints, plain)
        self.velocity = self.motion(qvel)

    def motion(self, vector: np.ndarray) -> Motion:
        """A vector f[nv, B] as the stepper has it: linear parts in the torso's frame."""
        base = [*self.standing.to_torso(list(jnp.asarray(vector[:3]))), *jnp.asarray(vector[3:6])]
        return Motion(base, list(by_link(jnp.asarray(vector), self.ids.dof)))

    def vector(self, motion: Motion) -> np.ndarray:
        """f[B, nv]: the inverse."""
        spread = [jnp.broadcast_to(x, (self.star.legs, ROBOTS)) for x in motion.legs]
        joints = by_id(jnp.stack(spread), self.ids.dof)
        rows = [*self.standing.to_world(motion.base[:3]), *motion.base[3:], *joints]
        return np.array([np.broadcast_to(row, ROBOTS) for row in rows]).T


@pytest.fixture(autouse=True, scope="module")
def exact():
    """Double precision, and per robot [B] may meet per leg [L, B] as it does in the stepper."""
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module", params=[load_model, quadruped, crab, hopper], ids=lambda make: make.__name__)
def posed(request):
    return Posed(request.param())


def test_spheres_are_where_mujoco_has_them(posed):
    for spheres, centre in zip(posed.star.spheres, posed.legs.spheres, strict=True):
        at = spheres.position if centre is None else centre
        for place in np.flatnonzero(spheres.geoms != FILLER):
            seen = np.array([np.broadcast_to(x, (len(spheres.geoms), ROBOTS))[place] for x in at])
            for robot, data in enumerate(posed.data):
                expected = data.body(1).xmat.reshape(3, 3).T @ (
                    data.geom_xpos[spheres.geoms[place]] - data.body(1).xpos
                )
                np.testing.assert_allclose(seen[:, robot], expected, atol=1e-12)


def test_the_mass_matrix_is_that_of_mujoco(posed):
    mass = dynamics.mass_matrix(posed.star, posed.body, posed.legs, plain)
    vectors = np.random.default_rng(1).normal(size=(posed.model.nv, ROBOTS))
    found = posed.vector(arrow.times(mass, posed.motion(vectors)))
    for data, vector, row in zip(posed.data, vectors.T, found, strict=True):
        expected = np.zeros(posed.model.nv)
        mujoco.mj_mulM(posed.model, data, expected, vector)
        np.testing.assert_allclose(row, expected, rtol=1e-10, atol=1e-12)


def test_the_bias_is_that_of_mujoco(posed):
    pull = dynamics.bias(posed.star, posed.body, posed.legs, posed.standing, posed.velocity, plain)
    expected = np.array([data.qfrc_bias for data in posed.data])
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(posed.vector(pull), expected, rtol=1e-10, atol=1e-12)


def test_servos_springs_and_dampers_are_those_of_mujoco(posed):
    none = Motion([0.0] * 6, [0.0] * len(posed.star.links))
    force = dynamics.smooth_force(posed.star, posed.body, posed.joints, posed.velocity, posed.targets, none)
    expected = np.array([data.qfrc_actuator + data.qfrc_passive for data in posed.data])
    assert not np.any(force.base)
    np.testing.assert_allclose(posed.vector(force._replace(base=[0.0] * 6))[:, 6:], expected[:, 6:], atol=1e-12)
