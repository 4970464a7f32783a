"""Small vectors and matrices, against NumPy and MuJoCo."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env.star import algebra
from srl_jax.env.star.algebra import ENTRIES, PLACE

ROBOTS = 5
rng = np.random.default_rng(0)


def array(*shape: int) -> np.ndarray:
    return rng.normal(size=(*shape, ROBOTS))


def entries(x: np.ndarray) -> list:
    """The entries of vectors [3, B] or matrices [3, 3, B], as the stepper has them."""
    return [row if row.ndim == 1 else list(row) for row in x]


def dense(symmetric: list) -> np.ndarray:
    """f[3, 3, B] of a `Symmetric`."""
    return np.array([[symmetric[PLACE[i][j]] * np.ones(ROBOTS) for j in range(3)] for i in range(3)])


def test_vectors():
    u, v, w = array(3), array(3), array(3)
    np.testing.assert_allclose(algebra.cross(u, v), np.cross(u, v, axis=0))
    np.testing.assert_allclose(algebra.dot(u, v), (u * v).sum(0))
    np.testing.assert_allclose(algebra.plus(u, v, w), u + v + w)
    np.testing.assert_allclose(algebra.minus(u, v), u - v)
    np.testing.assert_allclose(algebra.scale(2.0, u), 2 * u)


def test_matrices():
    a, b, v = array(3, 3), array(3, 3), array(3)
    np.testing.assert_allclose(algebra.matvec(entries(a), entries(v)), np.einsum("ijb,jb->ib", a, v))
    np.testing.assert_allclose(algebra.matmul(entries(a), entries(b)), np.einsum("ijb,jkb->ikb", a, b))
    full = np.einsum("ijb,jb,kjb->ikb", a, v, a)
    similar = algebra.similar(entries(a), entries(v))
    np.testing.assert_allclose(similar, [full[i, j] for i, j in ENTRIES])
    np.testing.assert_allclose(dense(similar), full)
    np.testing.assert_allclose(algebra.symvec(similar, entries(v)), np.einsum("ijb,jb->ib", full, v))


def test_steiner_is_the_inertia_of_a_point_mass():
    mass, com = array(), array(3)
    expected = mass * ((com * com).sum(0) * np.eye(3)[:, :, None] - com[:, None] * com[None])
    np.testing.assert_allclose(dense(algebra.steiner(mass, entries(com))), expected, atol=1e-12)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (0.48, 0.6, 0.64)])
def test_a_turn_about_an_axis_is_that_of_its_quaternion(axis):
    angles = array()
    turned = algebra.about_axis(list(axis), np.sin(angles), np.cos(angles))
    for robot, angle in enumerate(angles):
        quaternion, matrix = np.zeros(4), np.zeros(9)
        mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
        mujoco.mju_quat2Mat(matrix, quaternion)
        found = [[x if algebra.is_number(x) else x[robot] for x in row] for row in turned]
        np.testing.assert_allclose(found, matrix.reshape(3, 3), atol=1e-12)


def test_a_link_without_an_axis_does_not_turn():
    """Of two legs the second has no such link."""
    axis = [np.array([[0.6], [0.0]]), np.array([[0.0], [0.0]]), np.array([[0.8], [0.0]])]
    angles = np.array([[0.5], [0.0]])
    turned = algebra.about_axis(axis, np.sin(angles), np.cos(angles))
    np.testing.assert_allclose(np.array(turned)[:, :, 1, 0], np.eye(3))
    assert np.abs(np.array(turned)[:, :, 0, 0] - np.eye(3)).max() > 0.1


def test_zeros_and_ones_leave_no_operation():
    x = jnp.arange(3.0)
    assert algebra.mul(x, 1.0) is algebra.add(0.0, x) is algebra.sub(x, 0.0) is x
    assert algebra.mul(0.0, x) == 0.0

    def turned(x: jax.Array):
        return algebra.matvec(algebra.about_axis([0.0, 0.0, 1.0], jnp.sin(x), jnp.cos(x)), [x, 0.0, 1.0])

    assert turned(x)[2] == 1.0
    needed = [equation.primitive.name for equation in jax.make_jaxpr(lambda x: turned(x)[:2])(x).eqns]
    assert needed.count("mul") == 2 and "add" not in needed


def test_sums_over_legs():
    for legs in range(1, 8):
        x = array(legs)
        np.testing.assert_allclose(algebra.gathered(x), x.sum(0), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(algebra.gathered(x[None], axis=1), x.sum(0)[None], rtol=1e-5, atol=1e-6)
    assert algebra.gathered(0.0) == 0.0


def test_sine_and_cosine_in_single_precision():
    x = np.concatenate([np.linspace(-10, 10, 20_001), np.linspace(-1e4, 1e4, 20_001), np.pi / 4 * np.arange(-40, 41)])
    x = x.astype(np.float32)
    sine, cosine = jax.jit(algebra.sincos)(x)
    assert sine.dtype == cosine.dtype == np.float32
    exact = x.astype(np.float64)
    np.testing.assert_allclose(sine, np.sin(exact), rtol=0, atol=1.2e-7)
    np.testing.assert_allclose(cosine, np.cos(exact), rtol=0, atol=1.2e-7)
    small = np.abs(exact) < 1e-3
    np.testing.assert_allclose(sine[small], np.sin(exact[small]), rtol=2e-7, atol=0)


def test_sine_and_cosine_in_double_precision():
    x = np.linspace(-100, 100, 1_001)
    with jax.enable_x64(True):
        sine, cosine = algebra.sincos(jnp.asarray(x))
        np.testing.assert_allclose(sine, np.sin(x), atol=1e-15)
        np.testing.assert_allclose(cosine, np.cos(x), atol=1e-15)
