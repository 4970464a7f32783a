"""Coverage on draws whose calibration is known, and a small ensemble that is less sure off its data."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from srl_jax.agents.networks import Critic
from srl_jax.bayes import dropout
from srl_jax.bayes.calibration import central_level, coverage, expected_error, spread

RNG = np.random.default_rng(0)
LEVELS = (0.5, 0.8, 0.95)


@pytest.mark.parametrize(("estimator", "draws"), [("rank", 199), ("gaussian", 199), ("gaussian", 2000)])
def test_coverage_is_the_level_for_calibrated_gaussian_draws(estimator, draws):
    n = 4000
    location, scale = RNG.normal(size=n) * 5, RNG.uniform(0.1, 3, size=n)
    sample = location + scale * RNG.normal(size=(draws, n))
    found = coverage(sample, location + scale * RNG.normal(size=n), LEVELS, estimator)
    np.testing.assert_allclose(found, LEVELS, atol=0.025)


@pytest.mark.parametrize("estimator", ["rank", "gaussian"])
def test_coverage_of_a_posterior_too_narrow_and_too_wide(estimator):
    from scipy.stats import norm

    sample, truth = RNG.normal(size=(999, 5000)), RNG.normal(size=5000)
    for factor in (0.5, 2.0):
        expected = 2 * norm.cdf(factor * norm.ppf(0.5 + 0.5 * np.array(LEVELS))) - 1
        np.testing.assert_allclose(coverage(factor * sample, truth, LEVELS, estimator), expected, atol=0.025)


def test_coverage_by_rank_is_exact_for_any_distribution():
    """Every rank once: the interval of level c holds a share c of them to the digit."""
    sample = np.exp(np.arange(99.0))[:, None].repeat(100, axis=1)
    truths = np.concatenate([[0.0], np.exp(np.arange(99.0)) * 1.1])
    np.testing.assert_allclose(coverage(sample, truths, (0.1, 0.5, 0.8, 0.9)), (0.1, 0.5, 0.8, 0.9), atol=1e-12)


def test_a_rank_at_the_end_of_an_interval_is_inside():
    sample = np.arange(9.0)[:, None].repeat(10, axis=1)
    np.testing.assert_allclose(coverage(sample, np.arange(10) - 0.5, (0.1, 0.3, 0.5, 0.7)), (0.2, 0.4, 0.6, 0.8))


@pytest.mark.parametrize("estimator", ["rank", "gaussian"])
def test_draws_without_spread_cover_only_themselves(estimator):
    np.testing.assert_array_equal(coverage(np.ones((19, 2)), [1.0, 1.1], (0.5,), estimator), [0.5])
    assert central_level(np.ones((19, 1)), [1.0], estimator)[0] == 0.0


def test_expected_calibration_error_is_the_distance_of_probabilities_from_frequencies():
    claimed = np.repeat([0.05, 0.45, 1.0], [10, 20, 10])
    came = np.concatenate([np.arange(10) < 3, np.arange(20) < 9, np.arange(10) < 6])
    assert expected_error(claimed, came) == pytest.approx((10 * 0.25 + 20 * 0.0 + 10 * 0.4) / 40)
    assert expected_error(claimed, came, bins=1) == pytest.approx(abs(came.mean() - claimed.mean()))
    honest = RNG.uniform(size=50_000)
    assert expected_error(honest, RNG.uniform(size=50_000) < honest) < 0.02
    assert expected_error(honest, RNG.uniform(size=50_000) < honest**2) == pytest.approx(1 / 6, abs=0.02)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"outcome": np.ones(3)}, r"outcome is float64\[3\]"),
        ({"outcome": np.ones(2, bool)}, r"probability has shape \(3,\), outcome is bool\[2\]"),
        ({"bins": 0}, "bins 0"),
        ({"probability": [0.1, 0.2, 1.2]}, r"probability lies in 0.1..1.2; it must lie in 0..1"),
    ],
)
def test_what_is_no_probability_is_refused(changed, message):
    given = {"probability": [0.1, 0.2, 0.3], "outcome": np.array([True, False, True]), "bins": 5} | changed
    with pytest.raises(ValueError, match=message):
        expected_error(given["probability"], given["outcome"], given["bins"])


def test_spread_is_numpys():
    sample, inside = RNG.normal(size=(50, 6)) * np.arange(1, 7), np.arange(6) < 2
    variance = sample.var(0, ddof=1)
    np.testing.assert_allclose(spread(sample, inside), np.sqrt([variance[:2].mean(), variance[2:].mean()]))


def test_a_fitted_ensemble_with_dropout_is_less_sure_outside_its_data():
    critic, members, widths = Critic((32, 32), False), 4, (32, 32)
    x = jnp.linspace(-1.0, 1.0, 40)[:, None]
    y, nothing = jnp.sin(3.0 * x[:, 0]), jnp.zeros(0)
    masks_of = jax.vmap(lambda key: dropout.sample_masks(key, widths, (40,), jnp.float32(0.05)))
    optimiser = optax.adam(1e-2)

    def loss(params, masks):
        over_rows = jax.vmap(critic.apply, (None, None, 0, 0))
        return jnp.sum(
            jnp.mean(jnp.square(jax.vmap(over_rows, (0, None, None, 0))(params, nothing, x, masks) - y[None]), 1)
        )

    def update(carry, key):
        params, state = carry
        gradient = jax.grad(lambda p: loss(p, masks_of(jax.random.split(key, members))))(params)
        direction, state = optimiser.update(gradient, state)
        return (optax.apply_updates(params, direction), state), None

    @jax.jit
    def fitted_draws(key):
        keys = jax.random.split(key, 3)
        params = jax.vmap(lambda k: critic.init(k, nothing, x[0]))(jax.random.split(keys[0], members))
        (params, _), _ = jax.lax.scan(update, (params, optimiser.init(params)), jax.random.split(keys[1], 400))
        masks = dropout.sample_masks(keys[2], widths, (members, 16), jnp.float32(0.05))
        return dropout.q_draws(critic.apply, params, nothing, 3.0 * x, masks)

    sample = fitted_draws(jax.random.key(0))
    found = spread(sample, np.abs(3.0 * x[:, 0]) <= 1.0)
    assert found.outside > 2.0 * found.inside > 0.0


@pytest.mark.parametrize(
    ("draws", "truths", "levels", "estimator", "message"),
    [
        (np.zeros((0, 3)), np.zeros(3), (0.5,), "rank", "M at least 1"),
        (np.zeros((1, 3)), np.zeros(3), (0.5,), "gaussian", "M at least 2"),
        (np.zeros(3), np.zeros(3), (0.5,), "rank", "must be \\[M, N\\]"),
        (np.zeros((5, 3)), np.zeros(2), (0.5,), "rank", "truths has shape"),
        (np.full((5, 3), np.nan), np.zeros(3), (0.5,), "rank", "not finite"),
        (np.zeros((5, 3)), np.full(3, np.inf), (0.5,), "rank", "finite values"),
        (np.zeros((5, 3)), np.zeros(3), (0.9,), "rank", "below 0.8333"),
        (np.zeros((5, 3)), np.zeros(3), (1.0,), "gaussian", "below 1"),
        (np.zeros((5, 3)), np.zeros(3), (0.5,), "exact", "choose rank or gaussian"),
    ],
)
def test_bad_input_is_refused(draws, truths, levels, estimator, message):
    with pytest.raises(ValueError, match=message):
        coverage(draws, truths, levels, estimator)


@pytest.mark.parametrize("inside", [[True, True], [False, False], [True], [1, 0]])
def test_spread_needs_both_kinds(inside):
    with pytest.raises(ValueError, match="both kinds"):
        spread(np.zeros((3, 2)), np.array(inside))
