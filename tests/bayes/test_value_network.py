"""The healthy value's network, against a chain whose value is known, and its posterior's bookkeeping."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes import dropout, value
from srl_jax.bayes import value_network as network
from srl_jax.bayes.value import HealthyEpisodes
from srl_jax.bayes.value_network import ValueConfig

GAMMA = 0.97
CONFIG = ValueConfig(gamma=GAMMA, hidden=(16,), dropout=0.05, updates=1200, batch=256, learning_rate=1e-2)
fit = jax.jit(jax.vmap(partial(network.fit, config=CONFIG), (None, 0)))
short = jax.jit(jax.vmap(partial(network.fit, config=replace(CONFIG, updates=10)), (None, 0)))

# Two states, A (slippery way in) and B (where the goal is); rows are success, failure, to A, to B.
CHAIN = np.array([[0.01, 0.04, 0.80, 0.15], [0.05, 0.01, 0.04, 0.90]])


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
    logits = jax.vmap(partial(network.ValueNetwork(CONFIG.hidden).apply, params))(jnp.eye(2))
    return value.combine(*jax.nn.sigmoid(logits).T, GAMMA)


@pytest.fixture(scope="module")
def truncated():
    """Three members fitted to episodes of at most 8 steps, and those episodes."""
    data = simulate(6000, 8)
    return data, fit(data, jax.random.split(jax.random.key(0), 3))


def test_targets_of_the_three_ends():
    end = jnp.array([0.6, 0.3])
    say = lambda s, f: network.targets(jnp.float32(4.0), jnp.bool_(s), jnp.bool_(f), end, GAMMA)  # noqa: E731
    np.testing.assert_allclose(say(True, False), [1.0, GAMMA**3], rtol=1e-5)
    np.testing.assert_allclose(say(False, True), [0.0, 0.0])
    np.testing.assert_allclose(say(False, False), [0.6, GAMMA**4 * 0.3], rtol=1e-5)


def test_the_true_value_is_a_fixed_point_of_the_targets():
    """One step of the chain, its successor valued exactly, says the exact value on average."""
    success, discount = chain_value(GAMMA)
    one = jnp.float32(1.0)
    for state in range(2):
        ends = [network.targets(one, jnp.bool_(i == 0), jnp.bool_(i == 1), jnp.zeros(2), GAMMA) for i in range(2)]
        for after in range(2):
            end = jnp.array([success[after], success[after] * discount[after]])
            ends.append(network.targets(one, jnp.bool_(False), jnp.bool_(False), end, GAMMA))
        expected = [success[state], success[state] * discount[state]]
        np.testing.assert_allclose(CHAIN[state] @ np.stack(ends), expected, rtol=1e-5)


def test_loss_is_least_at_the_conditional_means():
    rng = np.random.default_rng(2)
    y0 = rng.random(50)
    y = np.stack([y0, y0 * rng.random(50)], axis=1).astype(np.float32)
    best = np.array([y[:, 0].mean(), y[:, 1].mean() / y[:, 0].mean()])
    mean_loss = lambda logits: jnp.mean(jax.vmap(network.cross_entropy, (None, 0))(logits, y))  # noqa: E731
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
    drawn = jax.jit(partial(network.draws, config=CONFIG))(fitted.params, jnp.eye(2)[0], masks)
    for k in range(3):
        for j in range(4):
            params = jax.tree.map(lambda x, k=k: x[k], fitted.params)
            logits = network.ValueNetwork(CONFIG.hidden).apply(params, jnp.eye(2)[0], (masks[0][k, j],))
            np.testing.assert_allclose(drawn.success[j * 3 + k], jax.nn.sigmoid(logits[0]), rtol=1e-5)
    np.testing.assert_allclose(drawn.value, drawn.success * drawn.discount / (1 - GAMMA), rtol=1e-5)
    np.testing.assert_allclose(GAMMA ** (np.asarray(drawn.steps) - 1.0), drawn.discount, rtol=1e-4)
    summary = network.posterior(drawn)
    np.testing.assert_allclose(summary.mean.value, np.mean(drawn.value), rtol=1e-5)
    np.testing.assert_allclose(summary.std.steps, np.std(drawn.steps), rtol=1e-4)
    assert summary.ok and summary.std.success > 0
    assert not network.posterior(drawn._replace(value=drawn.value.at[0].set(jnp.nan))).ok


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


@pytest.mark.parametrize("bad", [{"gamma": 1.0}, {"dropout": 1.0}, {"dropout": -0.1}, {"updates": 0}, {"batch": 0}])
def test_bad_settings_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ValueConfig(**bad)


def test_no_draws_are_refused(truncated):
    with pytest.raises(ValueError, match="at least one"):
        network.draws(truncated[1].params, jnp.eye(2)[0], (jnp.ones((3, 0, 16)),), config=CONFIG)
