"""Precision weighting: the product of two Gaussians, its limits, and the moments that go in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes.fusion import Gaussian, fuse, moments

INF, NAN = np.inf, np.nan
RNG = np.random.default_rng(0)


def scalar(m1, v1, m2, v2) -> tuple[float, float]:
    args = [jnp.float32(x) for x in (m1, v1, m2, v2)]
    mean, variance = jax.jit(fuse)(Gaussian(*args[:2]), Gaussian(*args[2:]))
    return float(mean), float(variance)


def test_equals_the_product_of_the_densities():
    x = np.linspace(-20.0, 20.0, 200_001)
    for m1, v1, m2, v2 in ((0.5, 1.0, -1.0, 0.25), (3.0, 0.1, 2.0, 2.0), (-1.0, 1.5, 1.0, 1.5)):
        density = np.exp(-((x - m1) ** 2) / (2 * v1) - (x - m2) ** 2 / (2 * v2))
        density /= density.sum()
        mean = (x * density).sum()
        np.testing.assert_allclose(
            scalar(m1, v1, m2, v2), (mean, ((x - mean) ** 2 * density).sum()), rtol=1e-5, atol=1e-9
        )


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ((1.0, 0.0, 5.0, 2.0), (1.0, 0.0)),
        ((1.0, 2.0, 5.0, 0.0), (5.0, 0.0)),
        ((1.0, INF, 5.0, 2.0), (5.0, 2.0)),
        ((1.0, 2.0, 5.0, INF), (1.0, 2.0)),
        ((1.0, INF, 5.0, 0.0), (5.0, 0.0)),
        ((1.0, 0.0, 5.0, 0.0), (3.0, 0.0)),
        ((1.0, INF, 5.0, INF), (3.0, INF)),
        ((NAN, INF, 5.0, 2.0), (5.0, 2.0)),
        ((1.0, 3e38, 5.0, 3e38), (3.0, 1.5e38)),
        ((1.0, 1e-30, 5.0, 3e-30), (2.0, 7.5e-31)),
        ((1.0, 1e-30, 5.0, 1e30), (1.0, 1e-30)),
    ],
)
def test_limits_are_safe_and_symmetric(case, expected):
    np.testing.assert_allclose(scalar(*case), expected, rtol=1e-6)
    np.testing.assert_allclose(scalar(*case[2:], *case[:2]), expected, rtol=1e-6)


@pytest.mark.parametrize("case", [(1.0, NAN, 5.0, 2.0), (NAN, 1.0, 5.0, 2.0)])
def test_a_fault_is_not_hidden(case):
    assert np.isnan(scalar(*case)[0])


def test_pytrees_are_fused_entry_by_entry_and_differentiable():
    def tree(low: float) -> dict:
        return {"w": jnp.asarray(RNG.uniform(low, 2, (3, 2)), jnp.float32), "b": (jnp.float32(RNG.uniform(low, 2)),)}

    first, second = Gaussian(tree(-2), tree(0.1)), Gaussian(tree(-2), tree(0.1))
    mean, variance = jax.jit(fuse)(first, second)
    parts = [jax.tree.leaves(x) for x in (*first, *second, mean, variance)]
    for m1, v1, m2, v2, m, v in zip(*parts, strict=True):
        np.testing.assert_allclose(m, (m1 / v1 + m2 / v2) / (1 / v1 + 1 / v2), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(v, 1 / (1 / v1 + 1 / v2), rtol=1e-5)
    assert jax.tree.structure(mean) == jax.tree.structure(variance) == jax.tree.structure(first.mean)
    slope = jax.grad(lambda m: fuse(Gaussian(m, jnp.zeros(())), Gaussian(m, jnp.float32(INF))).mean)(jnp.float32(1.0))
    assert slope == 1.0


def test_moments_are_numpys_unbiased_ones():
    draws = {"w": RNG.normal(2.0, 3.0, (7, 4, 2)).astype(np.float32), "b": RNG.normal(size=7).astype(np.float32)}
    found = jax.jit(moments)(draws)
    for name, values in draws.items():
        np.testing.assert_allclose(found.mean[name], values.mean(0), rtol=1e-5)
        np.testing.assert_allclose(found.variance[name], values.var(0, ddof=1), rtol=1e-5)


@pytest.mark.parametrize("shape", [(0, 3), (1, 3), ()])
def test_too_few_draws_are_refused(shape):
    with pytest.raises(ValueError, match=r"draws: \['w'\] has shape"):
        moments({"w": jnp.zeros(shape)})


def test_mismatched_trees_are_refused():
    one, other = jnp.ones(2), jnp.ones(3)
    with pytest.raises(AssertionError):
        fuse(Gaussian(one, one), Gaussian(other, other))
