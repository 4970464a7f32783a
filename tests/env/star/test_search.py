"""The line search finds the least cost along a direction, as SciPy does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from srl_jax.env.star.rows import Contact, Limits, Rows, Values
from srl_jax.env.star.search import line_search

LEGS, ROBOTS = 3, 40


def plain(tree):
    """In place of a seam."""
    return tree


@pytest.fixture(scope="module")
def drawn():
    """Rows of legs, of two spheres on the base and of limits; residuals and their changes; the cost's smooth part."""
    rng = np.random.default_rng(0)
    weight = lambda n: rng.exponential(5.0, (n, ROBOTS)) * (rng.random((n, ROBOTS)) < 0.7)  # noqa: E731
    vector = lambda n: list(rng.normal(size=(3, n, ROBOTS)))  # noqa: E731
    contacts = [Contact([], None, weight(2), 0.0), Contact([], [[]], weight(LEGS), 0.0)]
    rows = Rows([], 0.5, contacts, Limits([weight(LEGS), weight(LEGS)], [], []))
    values = lambda: Values([vector(2), vector(LEGS)], list(rng.normal(size=(2, LEGS, ROBOTS))))  # noqa: E731
    inertial = rng.exponential(size=ROBOTS), -rng.exponential(3.0, ROBOTS), rng.exponential(size=ROBOTS)
    return rows, values(), values(), inertial


def edges(values: Values, robot: int) -> np.ndarray:
    """The rows of a robot, contacts by their four edges."""
    found = [x[:, robot] for x in values.limits]
    for normal, first, second in values.contacts:
        found += [(normal + sign * tangent)[:, robot] for tangent in (first, second) for sign in (1, -1)]
    return np.concatenate(found)


def cost(drawn, robot: int):
    rows, residual, change, inertial = drawn
    weights = [weight[:, robot] for weight in rows.limits.weight]
    weights += [contact.weight[:, robot] for contact in rows.contacts for _ in range(4)]
    r, j, d = edges(residual, robot), edges(change, robot), np.concatenate(weights)
    c0, c1, c2 = (x[robot] for x in inertial)
    return lambda size: c0 + c1 * size + c2 * size**2 + 0.5 * np.sum(d * np.minimum(r + size * j, 0) ** 2)


def search(drawn, iterations: int) -> np.ndarray:
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        rows, residual, change, inertial = jax.tree.map(jnp.asarray, drawn)
        enough = jnp.full(ROBOTS, 1e-12)
        find = jax.jit(lambda *args: line_search(*args, iterations, plain))
        return np.asarray(find(rows, residual, change, inertial, enough))


def test_the_least_cost_is_found(drawn):
    sizes = search(drawn, 50)
    for robot in range(ROBOTS):
        along = cost(drawn, robot)
        best = minimize_scalar(along, method="brent", tol=1e-12)
        assert along(sizes[robot]) <= best.fun + 1e-9 * abs(best.fun)


def test_few_iterations_never_make_it_worse(drawn):
    for iterations in (0, 2):
        sizes = search(drawn, iterations)
        assert all(cost(drawn, robot)(sizes[robot]) <= cost(drawn, robot)(0.0) for robot in range(ROBOTS))


def test_where_nothing_costs_less_it_stays(drawn):
    """Uphill in both directions: the start is the least."""
    rows, residual, change, _ = drawn
    flat = np.zeros(ROBOTS), np.zeros(ROBOTS), np.ones(ROBOTS)
    nothing = rows._replace(
        contacts=[c._replace(weight=0 * c.weight) for c in rows.contacts],
        limits=rows.limits._replace(weight=[0 * w for w in rows.limits.weight]),
    )
    np.testing.assert_array_equal(search((nothing, residual, change, flat), 2), 0.0)
