"""Masks and posterior draws against NumPy loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents.networks import Critic
from srl_jax.bayes import dropout

STATE, ACTION, K, J, N = 3, 2, 2, 3, 4
WIDTHS = (8, 6)
RNG = np.random.default_rng(0)
OBSERVATION = RNG.normal(size=STATE).astype(np.float32)
ACTIONS = RNG.normal(size=(N, ACTION)).astype(np.float32)

masks_of = jax.jit(dropout.sample_masks, static_argnums=(1, 2))


def network(layer_norm: bool):
    critic = Critic(WIDTHS, layer_norm)
    params = jax.vmap(lambda k: critic.init(k, OBSERVATION, ACTIONS[0]))(jax.random.split(jax.random.key(0), K))
    # Biases start at zero and scales at one, which would hide a mistake in them.
    leaves, tree = jax.tree.flatten(params)
    params = jax.tree.unflatten(tree, [leaf + 0.3 * RNG.normal(size=leaf.shape).astype(np.float32) for leaf in leaves])
    return critic.apply, params


def loop_q(params, member: int, action: np.ndarray, masks: list[np.ndarray], layer_norm: bool) -> float:
    """One forward pass by hand."""
    weights = jax.tree.map(lambda x: np.asarray(x[member]), params)["params"]
    x, torso = np.concatenate([OBSERVATION, action]), weights["Torso_0"]
    for layer, mask in enumerate(masks):
        x = x @ torso[f"Dense_{layer}"]["kernel"] + torso[f"Dense_{layer}"]["bias"]
        if layer_norm:
            norm = torso[f"LayerNorm_{layer}"]
            x = (x - x.mean()) / np.sqrt(x.var() + 1e-6) * norm["scale"] + norm["bias"]
        x = np.maximum(x, 0.0) * mask
    return float((x @ weights["Dense_0"]["kernel"] + weights["Dense_0"]["bias"])[0])


@pytest.mark.parametrize("rate", [0.0, 0.1, 0.5])
def test_masks_are_unbiased_and_take_two_values(rate):
    masks = masks_of(jax.random.key(0), (50, 20), (4, 100), jnp.float32(rate))
    assert [m.shape for m in masks] == [(4, 100, 50), (4, 100, 20)]
    keep = 1.0 - rate
    for mask in masks:
        assert mask.dtype == jnp.float32
        values = np.unique(mask)
        np.testing.assert_allclose(values, [1.0] if rate == 0 else [0.0, 1.0 / keep], rtol=1e-6)
        error = np.sqrt(rate / keep / mask.size)  # standard deviation of the mean
        np.testing.assert_allclose(mask.mean(), 1.0, atol=4 * error + 1e-6)
        np.testing.assert_allclose(np.mean(mask > 0), keep, atol=4 * error + 1e-6)


def test_masks_are_independent_over_layers_members_and_draws():
    masks = masks_of(jax.random.key(1), (500, 500), (2, 2), jnp.float32(0.5))
    rows = np.concatenate([np.asarray(m).reshape(4, 500) for m in masks])
    correlation = np.corrcoef(rows) - np.eye(8)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(500)


def test_rates_may_differ_between_lanes():
    rates, keys = jnp.array([0.0, 0.2, 0.9]), jax.random.split(jax.random.key(2), 3)
    one = lambda key, rate: dropout.sample_masks(key, WIDTHS, (K, J), rate)  # noqa: E731
    wide = jax.jit(jax.vmap(one))(keys, rates)
    for lane in range(3):
        alone = masks_of(keys[lane], WIDTHS, (K, J), rates[lane])
        for a, b in zip(alone, wide, strict=True):
            np.testing.assert_allclose(a, b[lane], rtol=1e-6)
    np.testing.assert_array_equal(wide[0][0], 1.0)


@pytest.mark.parametrize("layer_norm", [False, True])
@pytest.mark.parametrize("own", [False, True])
def test_draws_equal_a_loop_over_members_and_masks(layer_norm, own):
    critic, params = network(layer_norm)
    shape = (K, J, N) if own else (K, J)
    masks = masks_of(jax.random.key(3), WIDTHS, shape, jnp.float32(0.3))
    draws = jax.jit(lambda m: dropout.q_draws(critic, params, OBSERVATION, ACTIONS, m))(masks)
    expected = np.zeros((K * J, N))
    for k in range(K):
        for j in range(J):
            for n in range(N):
                where = (k, j, n) if own else (k, j)
                mask = [np.asarray(m[where]) for m in masks]
                expected[j * K + k, n] = loop_q(params, k, ACTIONS[n], mask, layer_norm)
    np.testing.assert_allclose(draws, expected, rtol=2e-5, atol=2e-5)


def test_shared_masks_make_equal_actions_tie_exactly():
    critic, params = network(True)
    twice = jnp.stack([ACTIONS[0], ACTIONS[1], ACTIONS[0]])
    draw = jax.jit(lambda m: dropout.q_draws(critic, params, OBSERVATION, twice, m))
    shared = draw(masks_of(jax.random.key(4), WIDTHS, (K, J), jnp.float32(0.3)))
    np.testing.assert_array_equal(shared[:, 0], shared[:, 2])
    assert np.std(shared[:, 0]) > 0
    own = draw(masks_of(jax.random.key(4), WIDTHS, (K, J, 3), jnp.float32(0.3)))
    assert np.all(own[:, 0] != own[:, 2])


def test_without_dropout_the_draws_are_the_members():
    critic, params = network(False)
    masks = masks_of(jax.random.key(5), WIDTHS, (K, J), jnp.float32(0.0))
    draws = dropout.q_draws(critic, params, OBSERVATION, ACTIONS, masks)
    members = jnp.stack([critic(jax.tree.map(lambda x, k=k: x[k], params), OBSERVATION, ACTIONS[0]) for k in range(K)])
    np.testing.assert_allclose(draws[:, 0], np.tile(members, J), rtol=1e-5)
    np.testing.assert_allclose(dropout.mean_q(critic, params, OBSERVATION, ACTIONS[0]), draws[:, 0].mean(), rtol=1e-5)


def test_draws_under_vmap_equal_one_by_one():
    critic, params = network(True)
    masks = masks_of(jax.random.key(6), WIDTHS, (K, J), jnp.float32(0.3))
    observations = jnp.stack([OBSERVATION, OBSERVATION + 1.0])
    draw = lambda o: dropout.q_draws(critic, params, o, ACTIONS, masks)  # noqa: E731
    wide = jax.jit(jax.vmap(draw))(observations)
    for row, observation in zip(wide, observations, strict=True):
        np.testing.assert_allclose(row, draw(observation), rtol=1e-5, atol=1e-6)
