"""Networks against a forward pass by hand."""

import jax
import numpy as np
import pytest

from srl_jax.agents.networks import Actor, Critic

HIDDEN, OBSERVATION, ACTION = (8, 6), 4, 2
RNG = np.random.default_rng(0)
X, U = RNG.normal(size=(5, OBSERVATION)).astype("f"), RNG.normal(size=(5, ACTION)).astype("f")


def shaken(params):
    """Parameters with biases and scales away from their start."""
    return jax.tree.map(lambda p: p + 0.3 * RNG.normal(size=p.shape).astype("f"), params)


def forward(params, x, masks=(1.0, 1.0), *, layer_norm: bool) -> np.ndarray:
    torso = params["Torso_0"]
    for layer, mask in enumerate(masks):
        x = x @ torso[f"Dense_{layer}"]["kernel"] + torso[f"Dense_{layer}"]["bias"]
        if layer_norm:
            norm = torso[f"LayerNorm_{layer}"]
            x = (x - x.mean(-1, keepdims=True)) / np.sqrt(x.var(-1, keepdims=True) + 1e-6)
            x = x * norm["scale"][None] + norm["bias"][None]
        x = np.maximum(x, 0.0) * mask
    head = params["action"] if "action" in params else params["Dense_0"]
    return x @ head["kernel"] + head["bias"]


@pytest.mark.parametrize("layer_norm", [False, True])
def test_actor_equals_numpy(layer_norm):
    actor = Actor(HIDDEN, ACTION, layer_norm)
    params = shaken(actor.init(jax.random.key(0), X[0]))
    numpy = jax.tree.map(np.asarray, params["params"])
    expected = np.tanh(forward(numpy, X, layer_norm=layer_norm))
    np.testing.assert_allclose(jax.jit(actor.apply)(params, X), expected, atol=1e-5)


@pytest.mark.parametrize("layer_norm", [False, True])
def test_critic_equals_numpy_with_and_without_masks(layer_norm):
    critic = Critic(HIDDEN, layer_norm)
    params = shaken(critic.init(jax.random.key(0), X[0], U[0]))
    numpy, joined = jax.tree.map(np.asarray, params["params"]), np.concatenate([X, U], axis=1)
    plain = jax.jit(critic.apply)(params, X, U)
    assert plain.shape == (5,)
    np.testing.assert_allclose(plain, forward(numpy, joined, layer_norm=layer_norm)[:, 0], atol=1e-5)
    masks = tuple(RNG.integers(0, 3, size=(5, width)).astype("f") for width in HIDDEN)
    masked = jax.jit(critic.apply)(params, X, U, masks)
    np.testing.assert_allclose(masked, forward(numpy, joined, masks, layer_norm=layer_norm)[:, 0], atol=1e-5)
    ones = tuple(np.ones_like(mask) for mask in masks)
    np.testing.assert_allclose(jax.jit(critic.apply)(params, X, U, ones), plain, atol=1e-6)


def test_fresh_actor_is_bounded_and_near_the_stance():
    actor = Actor((64, 64), ACTION, True)
    params = actor.init(jax.random.key(0), X[0])
    assert np.abs(actor.apply(params, X)).max() < 0.2
    assert np.abs(actor.apply(shaken(params), 1e6 * X)).max() <= 1.0
