"""Descent and soft updates against optax and NumPy."""

import chex
import jax.numpy as jnp
import optax
import pytest

from srl_jax.agents import descent
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig


@pytest.mark.parametrize(("name", "rule"), [("adam", optax.adam), ("rmsprop", optax.rmsprop)])
def test_descent_equals_optax(name, rule):
    params, direction = {"w": jnp.array([1.0, -2.0])}, descent.optimiser(name)
    state, expected, reference = direction.init(params), params, rule(0.1).init(params)
    for scale in (1.0, -0.5, 2.0):
        gradient = {"w": jnp.array([scale, 3.0])}
        step, state = direction.update(gradient, state)
        params = descent.descend(params, step, jnp.float32(0.1))
        step, reference = rule(0.1).update(gradient, reference)
        expected = optax.apply_updates(expected, step)
    chex.assert_trees_all_close(params, expected, rtol=1e-5)


@pytest.mark.parametrize("tau", [0.0, 0.3, 1.0])
def test_soft_update(tau):
    online, old = {"w": jnp.array([1.0, -2.0])}, {"w": jnp.array([0.5, 4.0])}
    after = descent.track(online, old, hyper=from_config(DDPGConfig(), tau=tau))
    chex.assert_trees_all_close(after, {"w": (1 - tau) * old["w"] + tau * online["w"]}, atol=1e-6)
