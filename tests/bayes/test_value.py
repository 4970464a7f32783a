"""The healthy value: closed forms, censoring, and a network against chains whose value is known."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes import dropout, value
from srl_jax.bayes.value import HealthyEpisodes, ValueConfig

GAMMA = 0.97
CONFIG = ValueConfig(gamma=GAMMA, hidden=(16,), dropout=0.05, updates=1200, batch=256, learning_rate=1e-2)
limit = jax.jit(partial(value.product_limit, gamma=GAMMA))
fit = jax.jit(jax.vmap(partial(value.fit, config=CONFIG), (None, 0)))
short = jax.jit(jax.vmap(partial(value.fit, config=replace(CONFIG, updates=10)), (None, 0)))

# Two states, A (slippery way in) and B (where the goal is); rows are success, failure, to A, to B.
CHAIN = np.array([[0.01, 0.04, 0.80, 0.15], [0.05, 0.01, 0.04, 0.90]])


def outcomes(length, success, failure) -> HealthyEpisodes:
    """HealthyEpisodes of which only the ends matter."""
    return value.healthy_episodes(np.zeros((len(length), max(length) + 1, 1)), length, success, failure)


def chain_value(gamma: float) -> tuple[np.ndarray, np.ndarray]:
    """P(X_g) and the conditional discount of both states by linear equations."""
    p, go = CHAIN[:, 0], CHAIN[:, 2:]
    success = np.linalg.solve(np.eye(2) - go, p)
    return success, np.linalg.solve(np.eye(2) - gamma * go, p) / success


def simulate(episodes: int, steps: int, seed: int = 0) -> HealthyEpisodes:
    """The chain from either state, truncated after `steps`; states are one-hot rows, NaN past the end."""
    rng = np.random.default_rng(seed)
    state = rng.integers(2, size=episodes)
    path = np.full((episodes, steps + 1, 2), np.nan)
    path[:, 0] = np.eye(2)[state]
    length, end = np.full(episodes, steps), np.full(episodes, -1)
    for t in range(1, steps + 1):
        drawn = (rng.random(episodes)[:, None] > np.cumsum(CHAIN[state], axis=1)[:, :3]).sum(1)
        alive = end < 0
        length[alive & (drawn < 2)] = t
        end[alive & (drawn < 2)] = drawn[alive & (drawn < 2)]
        state = np.where(drawn < 2, state, drawn - 2)
        path[alive, t] = np.eye(2)[state[alive]]
    return value.healthy_episodes(path, length, end == 0, end == 1)


def exactly(params) -> value.HealthyValue:
    """The mean network at A and at B."""
    logits = jax.vmap(partial(value.ValueNetwork(CONFIG.hidden).apply, params))(jnp.eye(2))
    return value.combine(*jax.nn.sigmoid(logits).T, GAMMA)


@pytest.fixture(scope="module")
def truncated():
    """Three members fitted to episodes of at most 8 steps, and those episodes."""
    data = simulate(6000, 8)
    return data, fit(data, jax.random.split(jax.random.key(0), 3))


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


def test_targets_of_the_three_ends():
    end = jnp.array([0.6, 0.3])
    say = lambda s, f: value.targets(jnp.float32(4.0), jnp.bool_(s), jnp.bool_(f), end, GAMMA)  # noqa: E731
    np.testing.assert_allclose(say(True, False), [1.0, GAMMA**3], rtol=1e-5)
    np.testing.assert_allclose(say(False, True), [0.0, 0.0])
    np.testing.assert_allclose(say(False, False), [0.6, GAMMA**4 * 0.3], rtol=1e-5)


def test_the_true_value_is_a_fixed_point_of_the_targets():
    """One step of the chain, its successor valued exactly, says the exact value on average."""
    success, discount = chain_value(GAMMA)
    one = jnp.float32(1.0)
    for state in range(2):
        ends = [value.targets(one, jnp.bool_(i == 0), jnp.bool_(i == 1), jnp.zeros(2), GAMMA) for i in range(2)]
        for after in range(2):
            end = jnp.array([success[after], success[after] * discount[after]])
            ends.append(value.targets(one, jnp.bool_(False), jnp.bool_(False), end, GAMMA))
        expected = [success[state], success[state] * discount[state]]
        np.testing.assert_allclose(CHAIN[state] @ np.stack(ends), expected, rtol=1e-5)


def test_loss_is_least_at_the_conditional_means():
    rng = np.random.default_rng(2)
    y0 = rng.random(50)
    y = np.stack([y0, y0 * rng.random(50)], axis=1).astype(np.float32)
    best = np.array([y[:, 0].mean(), y[:, 1].mean() / y[:, 0].mean()])
    mean_loss = lambda logits: jnp.mean(jax.vmap(value.cross_entropy, (None, 0))(logits, y))  # noqa: E731
    np.testing.assert_allclose(jax.grad(mean_loss)(jnp.log(best / (1 - best))), 0.0, atol=1e-6)


def test_fit_recovers_the_chain_in_spite_of_truncation(truncated):
    data, fitted = truncated
    success, discount = chain_value(GAMMA)
    assert fitted.ok.all()
    undecided = ~np.asarray(data.success | data.failure)
    assert undecided.mean() > 0.5, "heavy truncation"
    for member in range(3):
        found = exactly(jax.tree.map(lambda x, i=member: x[i], fitted.params))
        np.testing.assert_allclose(found.success, success, atol=0.06)
        np.testing.assert_allclose(found.discount, discount, atol=0.05)
    won, first = np.asarray(data.success), np.asarray(data.observation)[:, 0, 0] == 1
    np.testing.assert_allclose(success, (0.61, 0.74), atol=0.005)
    as_failed = [won[start].mean() for start in (first, ~first)]
    np.testing.assert_allclose(as_failed, (0.16, 0.30), atol=0.01, err_msg="far off, as docs/ says")
    dropped = [won[start & ~undecided].mean() for start in (first, ~first)]
    np.testing.assert_allclose(dropped, (0.45, 0.77), atol=0.01, err_msg="off, as docs/ says")


def test_draws_are_ordered_and_summarised_over_members_and_masks(truncated):
    _, fitted = truncated
    masks = dropout.sample_masks(jax.random.key(1), CONFIG.hidden, (3, 4), jnp.float32(0.3))
    drawn = jax.jit(partial(value.draws, config=CONFIG))(fitted.params, jnp.eye(2)[0], masks)
    for k in range(3):
        for j in range(4):
            params = jax.tree.map(lambda x, k=k: x[k], fitted.params)
            logits = value.ValueNetwork(CONFIG.hidden).apply(params, jnp.eye(2)[0], (masks[0][k, j],))
            np.testing.assert_allclose(drawn.success[j * 3 + k], jax.nn.sigmoid(logits[0]), rtol=1e-5)
    np.testing.assert_allclose(drawn.value, drawn.success * drawn.discount / (1 - GAMMA), rtol=1e-5)
    np.testing.assert_allclose(GAMMA ** (np.asarray(drawn.steps) - 1.0), drawn.discount, rtol=1e-4)
    summary = value.posterior(drawn)
    np.testing.assert_allclose(summary.mean.value, np.mean(drawn.value), rtol=1e-5)
    np.testing.assert_allclose(summary.std.steps, np.std(drawn.steps), rtol=1e-4)
    assert summary.ok and summary.std.success > 0
    assert not value.posterior(drawn._replace(value=drawn.value.at[0].set(jnp.nan))).ok


def test_members_differ_and_do_not_see_each_other():
    data, keys = simulate(20, 8), jax.random.split(jax.random.key(0), 3)
    together, alone = short(data, keys), short(data, keys[1:2])
    for wide, one in zip(jax.tree.leaves(together.params), jax.tree.leaves(alone.params), strict=True):
        np.testing.assert_allclose(wide[1], one[0], rtol=1e-4, atol=1e-5)
        assert np.any(wide[0] != wide[1])


def test_a_fault_is_flagged_inside_jit():
    data = simulate(20, 8)
    broken = data._replace(observation=jnp.full_like(data.observation, jnp.nan))
    assert not short(broken, jax.random.split(jax.random.key(0), 3)).ok.any()


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


@pytest.mark.parametrize("bad", [{"gamma": 1.0}, {"dropout": 1.0}, {"dropout": -0.1}, {"updates": 0}, {"batch": 0}])
def test_bad_settings_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ValueConfig(**bad)


def test_no_draws_are_refused(truncated):
    with pytest.raises(ValueError, match="at least one"):
        value.draws(truncated[1].params, jnp.eye(2)[0], (jnp.ones((3, 0, 16)),), config=CONFIG)
