"""Decisions from posterior draws: closed forms, symmetry, and safety where the posterior is certain."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from srl_jax.bayes import thompson

ESTIMATORS = ("paired", "gaussian")
DRAWS = 20_000

better = jax.jit(thompson.probability_better, static_argnums=3)
choose = jax.jit(jax.vmap(thompson.choose, (None, 0)))


def draws_of(seed: int = 0, shape: tuple[int, ...] = (24, 4)) -> jax.Array:
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("seed", range(3))
def test_linear_critic_with_gaussian_weights_has_a_closed_form(estimator, seed):
    rng = np.random.default_rng(seed)
    mean, root = rng.normal(size=5), rng.normal(size=(5, 5))
    features = rng.normal(size=(2, 5))
    weights = mean + rng.normal(size=(DRAWS, 5)) @ root.T
    q = jnp.asarray(weights @ features.T, jnp.float32)
    d, covariance = features[0] - features[1], root @ root.T
    exact = norm.cdf(mean @ d / np.sqrt(d @ covariance @ d))
    error = np.sqrt(exact * (1 - exact) / DRAWS)
    assert better(q, 0, 1, estimator) == pytest.approx(exact, abs=4 * error)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("seed", range(5))
def test_probabilities_of_both_directions_sum_to_one(estimator, seed):
    draws = jnp.round(draws_of(seed), 1)  # rounded, so that some tie
    for i in range(4):
        for j in range(4):
            p, q = better(draws, i, j, estimator), better(draws, j, i, estimator)
            assert 0.0 <= p <= 1.0 and p + q == pytest.approx(1.0, abs=1e-6)
        assert better(draws, i, i, estimator) == 0.5


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_probability_grows_with_the_new_mean(estimator):
    draws = draws_of(shape=(50, 2))
    shifted = lambda shift: draws.at[:, 0].add(shift)  # noqa: E731
    p = jnp.stack([better(shifted(shift), 0, 1, estimator) for shift in np.linspace(-6.0, 6.0, 25)])
    assert np.all(np.diff(p) >= 0) and p[0] < 0.01 and p[-1] > 0.99 and p[0] < p[12] < p[-1]


def test_estimators_equal_their_formulas():
    draws = draws_of(7)
    difference = np.asarray(draws[:, 2] - draws[:, 1])
    assert better(draws, 2, 1, "paired") == pytest.approx(np.mean(difference > 0), abs=1e-6)
    exact = norm.cdf(difference.mean() / difference.std())
    assert better(draws, 2, 1, "gaussian") == pytest.approx(exact, abs=1e-5)


def test_a_tie_counts_half():
    draws = jnp.array([[1.0, 1.0], [2.0, 1.0], [0.0, 0.0], [0.0, 5.0]])
    assert better(draws, 0, 1, "paired") == pytest.approx((0.5 + 1 + 0.5 + 0) / 4)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(("gap", "expected"), [(0.0, 0.5), (1e-3, 1.0), (-1e-3, 0.0), (1e30, 1.0), (-1e-30, 0.0)])
def test_a_certain_posterior_decides_without_nan(estimator, gap, expected):
    draws = jnp.zeros((7, 2)).at[:, 0].set(gap)
    assert better(draws, 0, 1, estimator) == expected
    assert better(draws[:1], 0, 1, estimator) == expected, "a single draw has no variance either"


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_gradient_is_finite_where_the_posterior_is_certain(estimator):
    gradient = jax.grad(lambda d: thompson.probability_better(d, 0, 1, estimator))(jnp.ones((5, 2)))
    assert np.isfinite(gradient).all()


def test_unknown_estimator_names_the_choices():
    with pytest.raises(ValueError, match="estimator is 'mode': choose paired or gaussian"):
        thompson.probability_better(jnp.zeros((3, 2)), 0, 1, "mode")


def test_choice_has_the_posterior_frequency_of_being_best():
    draws = draws_of(1, (40, 3))
    choices = choose(draws, jax.random.split(jax.random.key(0), 4_000))
    frequency = np.bincount(np.asarray(choices), minlength=3) / 4_000
    exact = np.bincount(np.argmax(np.asarray(draws), axis=1), minlength=3) / 40
    np.testing.assert_allclose(frequency, exact, atol=4 * 0.5 / np.sqrt(4_000))
    assert choices.dtype == jnp.int32


def test_one_draw_judges_all_actions():
    # Under either sample an outer action is best; were columns drawn apart, the middle one would win sometimes.
    draws = jnp.array([[2.0, 1.0, 0.0], [0.0, 1.0, 2.0]])
    assert set(np.asarray(choose(draws, jax.random.split(jax.random.key(1), 200)))) == {0, 2}


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_vmap_over_pairs_and_lanes_equals_one_by_one(estimator):
    draws = jnp.stack([draws_of(s) for s in range(3)])
    pairs = jnp.array([[0, 1], [3, 2], [1, 1]])
    one = partial(thompson.probability_better, estimator=estimator)
    wide = jax.jit(jax.vmap(one))(draws, pairs[:, 0], pairs[:, 1])
    for lane in range(3):
        alone = better(draws[lane], int(pairs[lane, 0]), int(pairs[lane, 1]), estimator)
        assert wide[lane] == pytest.approx(float(alone), abs=1e-6)
