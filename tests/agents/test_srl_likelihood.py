"""SRL's likelihood of the critic against NumPy."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import dropout
from srl_jax.types import Transition
from tests.agents.reference import loop_draws

OBSERVATION, ACTION, BATCH = 4, 2, 6
FULL = SRLConfig(hidden=(8, 8), layer_norm=False, critics=2, batch=BATCH, dropout=(0.3,), draws=8)
init = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=FULL))
critic_loss = jax.jit(srl.critic_loss, static_argnames="config")
critic_of = jax.jit(ddpg.critic_fn(FULL))
KEY = jax.random.key(0)


def change(config: SRLConfig = FULL, **fields) -> SRLConfig:
    return dataclasses.replace(config, **fields)


def batch_of(seed: int = 0) -> Transition:
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.normal(size=(BATCH, *shape)).astype("f")  # noqa: E731
    discount = np.array([1, 1, 0, 1, 0, 1], "f")
    action = np.clip(draw(ACTION), -1, 1)
    return Transition(draw(OBSERVATION), action, draw(), discount, draw(OBSERVATION), np.zeros(BATCH, "f"))


def start() -> ddpg.AgentState:
    return init(KEY)


def test_alpha_divergence_equals_numpy():
    config, batch, state = change(critic_loss="alpha", weight_decay=(0.1,)), batch_of(), start()
    hyper, target = from_config(config), jnp.asarray(batch_of(1).reward)
    loss, metrics = critic_loss(state.critic, batch, target, KEY, config=config, hyper=hyper)
    masks = srl.posterior_masks(jax.random.split(KEY)[0], config=config, hyper=hyper)
    alpha, tau, value = 0.5, 10.0, 0.0
    for observation, action, y in zip(batch.observation, batch.action, target, strict=True):
        q = loop_draws(critic_of, state.critic, observation, [action], masks)[:, 0]
        value += -np.log(np.sum(np.exp(-0.5 * alpha * tau * (y - q) ** 2))) / alpha / BATCH
    squares = sum(float(np.sum(np.square(leaf))) for leaf in jax.tree.leaves(state.critic))
    assert metrics["critic_loss"] == pytest.approx(value, rel=1e-4)
    assert loss == pytest.approx(value + 0.1 * squares, rel=1e-4)


def test_squared_error_has_a_mask_per_sample_and_member():
    config, batch, state = change(dropout_update=True), batch_of(), start()
    hyper, target = from_config(config), jnp.asarray(batch.reward)
    loss, _ = critic_loss(state.critic, batch, target, KEY, config=config, hyper=hyper)
    masks = dropout.sample_masks(jax.random.split(KEY)[0], config.hidden, (2, BATCH), hyper.dropout)
    value = 0.0
    for b in range(BATCH):
        own = tuple(mask[:, b : b + 1] for mask in masks)
        q = loop_draws(critic_of, state.critic, batch.observation[b], [batch.action[b]], own)
        value += float(np.sum((q - batch.reward[b]) ** 2)) / BATCH
    assert loss == pytest.approx(value, rel=1e-5)


def test_bootstrap_leaves_samples_out_per_member():
    state, batch = start(), batch_of()
    zero = jnp.zeros(BATCH)
    full, _ = critic_loss(state.critic, batch, zero, KEY, config=FULL, hyper=from_config(FULL))
    none, _ = critic_loss(state.critic, batch, zero, KEY, config=FULL, hyper=from_config(FULL, bootstrap=0.0))
    half = from_config(FULL, bootstrap=0.5)
    some = jax.jit(jax.vmap(lambda k: srl.critic_loss(state.critic, batch, zero, k, config=FULL, hyper=half)[0]))
    values = some(jax.random.split(KEY, 400))
    assert none == 0.0 and np.all(values <= full + 1e-6) and len(np.unique(values)) > 20
    assert values.mean() == pytest.approx(0.5 * float(full), rel=0.1)
