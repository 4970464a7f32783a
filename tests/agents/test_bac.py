"""Bayesian actor-critic: its gradient against the dense form, what it learns, and what stops it."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from srl_jax.agents import bac
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import BACConfig
from srl_jax.bayes import gptd, gram
from srl_jax.types import Transition

OBSERVATION, ACTION = 3, 2
CONFIG = BACConfig(
    hidden=(8,), layer_norm=False, batch=32, init="random", freeze=(0.0,), actor_lr=(1e-2,), kernel_length=(3.0,)
)
HYPER = from_config(CONFIG)
KEY = jax.random.key(0)


def batch_of(key: jax.Array, size: int = 32) -> Transition:
    """Steps whose reward is the first action minus the second, and some of which end their episode."""
    keys = jax.random.split(key, 3)
    observation, after = jax.random.normal(keys[0], (2, size, OBSERVATION))
    action = jnp.clip(0.25 * jax.random.normal(keys[1], (size, ACTION)), -1.0, 1.0)
    reward = action[:, 0] - action[:, 1]
    return Transition(observation, action, reward, jnp.zeros(size), after, jnp.zeros(size), jnp.zeros(size))


@jax.jit
def update(state, batch, step=1e4):
    return bac.update(state, batch, KEY, config=CONFIG, hyper=HYPER, step=jnp.float32(step))


def begin() -> bac.BACState:
    return bac.init(KEY, OBSERVATION, ACTION, config=CONFIG)


def test_scores_are_the_gradient_of_the_gaussians_log_density():
    state, batch = begin(), batch_of(KEY, 4)
    found = bac.scores(state.actor, batch, jnp.float32(0.3), config=CONFIG)
    for i in range(4):
        mean, back = jax.vjp(lambda p, i=i: bac.student(p, batch.observation[i], config=CONFIG), state.actor)
        (expected,) = back((batch.action[i] - mean) / 0.09)
        chex.assert_trees_all_close(jax.tree.map(lambda x, i=i: x[i], found), expected, rtol=1e-4, atol=1e-5)


def test_gradient_is_that_of_the_dense_actor_critic():
    state, batch = begin(), batch_of(KEY)._replace(discount=jnp.tile(jnp.array([1.0, 0.0]), 16))
    moved, metrics = update(state, batch)
    directions = bac.scores(state.actor, batch, jnp.float32(0.25), config=CONFIG)
    flat = jax.vmap(lambda u: ravel_pytree(u)[0])(directions)
    ridge = gram.SHRINKAGE * jnp.mean(jnp.sum(jnp.square(flat), axis=1)) / len(flat)  # that of `gram.posterior`
    fisher = flat.T @ flat / len(flat) + ridge * jnp.eye(flat.shape[1])
    discounts = 0.97 * batch.discount
    data = gptd.Transitions(
        batch.observation, flat, batch.reward, discounts, batch.next_observation, jnp.zeros_like(flat)
    )
    critic = gptd.fit(data, gptd.rbf(3.0, 100.0), fisher, noise=0.1, scale=1.0)
    gradient = gptd.gradient(critic).mean
    first_moment = ravel_pytree(moved.actor_optimiser.mu)[0]
    scale = float(jnp.abs(gradient).max())
    np.testing.assert_allclose(first_moment, -0.1 * gradient, atol=2e-3 * scale)
    np.testing.assert_allclose(metrics["gradient_norm"], jnp.linalg.norm(gradient), rtol=1e-2)


def test_it_learns_which_action_pays():
    state = begin()
    for number in range(60):
        state, metrics = update(state, batch_of(jax.random.fold_in(KEY, number)))
    action = jax.vmap(lambda o: bac.student(state.actor, o, config=CONFIG))(batch_of(KEY).observation).mean(0)
    assert action[0] > 0.3 and action[1] < -0.3
    assert metrics["gradient_failed"] == 0.0 and metrics["explained"] > 0.0


def test_a_frozen_actor_and_a_process_that_fails_leave_the_actor_alone():
    state, batch = begin(), batch_of(KEY)
    frozen = dataclasses.replace(CONFIG, freeze=(100.0,))
    hyper = from_config(frozen)
    still, _ = bac.update(state, batch, KEY, config=frozen, hyper=hyper, step=jnp.float32(99.0))
    chex.assert_trees_all_equal(still.actor, state.actor)
    broken, metrics = update(state, batch._replace(reward=batch.reward.at[3].set(jnp.nan)))
    chex.assert_trees_all_equal(broken, state)
    assert metrics["gradient_failed"] == 1.0
