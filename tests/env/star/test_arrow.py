"""Block-arrow matrices, against dense ones."""

import jax
import numpy as np
import pytest

from srl_jax.env.star import arrow
from srl_jax.env.star.arrow import Arrow, Motion

ROBOTS = 3
SHAPES = [(4, 3), (1, 1), (2, 1), (3, 5)]  # legs, links


def plain(tree):
    """In place of a seam."""
    return tree


def full(legs: int, links: int) -> np.ndarray:
    """A positive definite matrix f[B, n, n] that couples each leg with the base and with itself."""
    rng = np.random.default_rng(legs + 10 * links)
    matrix = np.zeros((ROBOTS, 6 + legs * links, 6 + legs * links))
    for leg in range(legs):
        own = [*range(6), *range(6 + leg * links, 6 + (leg + 1) * links)]
        lever = rng.normal(size=(ROBOTS, len(own), len(own)))
        matrix[np.ix_(range(ROBOTS), own, own)] += lever @ lever.swapaxes(1, 2) + 0.1 * np.eye(len(own))
    return matrix


def as_arrow(matrix: np.ndarray, legs: int, links: int) -> Arrow:
    of_legs = lambda row, column: np.stack([matrix[:, row(leg), column(leg)] for leg in range(legs)])  # noqa: E731
    place = lambda k: lambda leg: 6 + leg * links + k  # noqa: E731
    return Arrow(
        [[matrix[:, r, c] for c in range(r + 1)] for r in range(6)],
        [[of_legs(lambda _, r=r: r, place(k)) for k in range(links)] for r in range(6)],
        [[of_legs(place(k), place(j)) for j in range(k + 1)] for k in range(links)],
    )


def as_motion(vector: np.ndarray, legs: int, links: int) -> Motion:
    inside = vector[:, 6:].reshape(ROBOTS, legs, links)
    return Motion(list(vector[:, :6].T), [inside[:, :, k].T for k in range(links)])


def check(found: Motion, expected: Motion) -> None:
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("legs", "links"), SHAPES)
def test_products_and_solutions_are_those_of_dense_matrices(legs, links):
    matrix = full(legs, links)
    x, y = np.random.default_rng(0).normal(size=(2, ROBOTS, matrix.shape[1]))
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        short, mx, my = as_arrow(matrix, legs, links), as_motion(x, legs, links), as_motion(y, legs, links)
        check(arrow.times(short, mx), as_motion(np.einsum("bij,bj->bi", matrix, x), legs, links))
        check(arrow.solve(short, mx, plain), as_motion(np.linalg.solve(matrix, x[..., None])[..., 0], legs, links))
        np.testing.assert_allclose(arrow.inner(mx, my), (x * y).sum(1))
        check(arrow.difference(mx, my), as_motion(x - y, legs, links))
        size = np.array([0.5, -2.0, 0.0])
        check(arrow.moved(mx, size, my), as_motion(x + size[:, None] * y, legs, links))


def test_zeros_of_the_robots_shape_may_be_numbers():
    """Two links that the base's first coordinate, and the first link the second, do not see."""
    matrix = full(3, 2)
    for k, leg in [(0, 0), (0, 1), (0, 2)]:
        matrix[:, 0, 6 + 2 * leg + k] = matrix[:, 6 + 2 * leg + k, 0] = 0.0
    matrix[:, 1, 0] = matrix[:, 0, 1] = 0.0
    matrix += 10 * np.eye(matrix.shape[1])
    short = as_arrow(matrix, 3, 2)
    short.base[1][0] = short.coupling[0][0] = 0.0
    x = np.random.default_rng(0).normal(size=(ROBOTS, matrix.shape[1]))
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        check(arrow.times(short, as_motion(x, 3, 2)), as_motion(np.einsum("bij,bj->bi", matrix, x), 3, 2))
        expected = as_motion(np.linalg.solve(matrix, x[..., None])[..., 0], 3, 2)
        check(arrow.solve(short, as_motion(x, 3, 2), plain), expected)
