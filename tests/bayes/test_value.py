"""The healthy value: closed forms, and what counting makes of episodes that are cut short."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes import value
from srl_jax.bayes.value import HealthyEpisodes

GAMMA = 0.97
limit = jax.jit(partial(value.product_limit, gamma=GAMMA))


def outcomes(length, success, failure) -> HealthyEpisodes:
    """HealthyEpisodes of which only the ends matter."""
    return value.healthy_episodes(np.zeros((len(length), max(length) + 1, 1)), length, success, failure)


def test_expectation_is_conditional_on_success():
    found, undecided = limit(outcomes([3, 10] * 8, [True, False] * 8, [False, True] * 8))
    np.testing.assert_allclose(found.value, 15.68, atol=5e-3)  # and not 14.18
    np.testing.assert_allclose(found.value, 0.5 * GAMMA**2 / (1 - GAMMA), rtol=1e-5)
    np.testing.assert_allclose((found.success, found.discount, found.steps), (0.5, GAMMA**2, 3.0), rtol=1e-5)
    assert undecided == 0.0


@pytest.mark.parametrize(("p", "f"), [(0.03, 0.02), (0.5, 0.5), (1.0, 0.0), (0.2, 0.0), (0.0, 0.3), (0.0, 0.0)])
def test_constant_hazard_is_the_closed_form_and_its_series(p, f):
    found = value.constant_hazard(jnp.float32(p), jnp.float32(f), GAMMA)
    np.testing.assert_allclose(found.value, p / ((1 - GAMMA) * (1 - GAMMA * (1 - p - f))), rtol=1e-5)
    t = np.arange(1, 5000)
    np.testing.assert_allclose(found.success, (p * (1 - p - f) ** (t - 1.0)).sum(), rtol=1e-5)
    discounted = (p * (GAMMA * (1 - p - f)) ** (t - 1.0)).sum()
    np.testing.assert_allclose(found.success * found.discount, discounted, rtol=1e-5)
    assert np.isinf(found.steps) == (p == 0.0) and not np.isnan(found.steps)


def test_product_limit_without_truncation_is_the_frequency():
    rng = np.random.default_rng(0)
    length, won = rng.integers(1, 30, size=200), rng.random(200) < 0.7
    found, undecided = limit(outcomes(length, won, ~won))
    np.testing.assert_allclose(found.success, won.mean(), rtol=1e-5)
    np.testing.assert_allclose(found.discount, (GAMMA ** (length[won] - 1.0)).mean(), rtol=1e-5)
    np.testing.assert_allclose(undecided, 0.0, atol=1e-5)


def test_product_limit_under_random_truncation_is_unbiased():
    p, f, n = 0.05, 0.03, 40_000
    rng = np.random.default_rng(1)
    end, cut = rng.geometric(p + f, n), rng.geometric(0.08, n)  # half are cut; the end at an equal step is seen
    seen, length = end <= cut, np.minimum(end, cut)
    won = seen & (rng.random(n) < p / (p + f))
    found, undecided = limit(outcomes(np.minimum(length, 60), won & (length <= 60), seen & ~won & (length <= 60)))
    exact = value.constant_hazard(jnp.float32(p), jnp.float32(f), GAMMA)
    np.testing.assert_allclose(found.success, exact.success, atol=0.02)
    np.testing.assert_allclose(found.value, exact.value, rtol=0.03)
    assert undecided < 0.02
    as_failed = won.mean() * (GAMMA ** (length[won] - 1.0)).mean() / (1 - GAMMA)
    assert as_failed < 0.75 * exact.value, "truncation counted as failure would be far off"


def test_product_limit_says_what_truncation_leaves_open():
    found, undecided = limit(outcomes([2, 5, 5, 5], [True, False, False, False], [False] * 4))
    np.testing.assert_allclose((found.success, undecided), (0.25, 0.75), rtol=1e-6)


GOOD = {"observation": np.zeros((2, 4, 1)), "length": [3, 1], "success": [True, False], "failure": [False, True]}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"observation": np.zeros((0, 4, 1)), "length": [], "success": [], "failure": []}, "N and T at least 1"),
        ({"observation": np.zeros((2, 4))}, "must be \\[N, T \\+ 1, O\\]"),
        ({"length": [3]}, "length has shape"),
        ({"failure": [False]}, "failure has shape"),
        ({"length": [4, 1]}, "must lie in 1..3"),
        ({"length": [0, 1]}, "must lie in 1..3"),
        ({"failure": [True, True]}, "say which came first"),
        ({"observation": np.full((2, 4, 1), np.inf)}, "not finite"),
    ],
)
def test_bad_episodes_are_refused(changed, message):
    value.healthy_episodes(**GOOD)
    with pytest.raises(ValueError, match=message):
        value.healthy_episodes(**GOOD | changed)


def test_rows_after_the_end_may_be_anything():
    observation = np.zeros((2, 4, 1))
    observation[1, 2:] = np.nan
    assert value.healthy_episodes(**GOOD | {"observation": observation}).length.tolist() == [3, 1]
