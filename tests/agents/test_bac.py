"""Bayesian actor-critic: its gradient against the dense form, what it learns, and what stops it."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
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


def jacobians(state, batch) -> np.ndarray:
    """Of the actor at every state: f32[B, A, n]."""
    flat, unravel = ravel_pytree(state.actor)
    policy = lambda params, o: bac.student(unravel(params), o, config=CONFIG)  # noqa: E731
    return np.asarray(jax.vmap(jax.jacobian(policy), (None, 0))(flat, batch.observation))


def flat_scores(state, batch, deviation=0.25) -> np.ndarray:
    """f32[B, n]."""
    found = bac.scores(state.actor, batch, jnp.float32(deviation), config=CONFIG)
    return np.asarray(jax.vmap(lambda u: ravel_pytree(u)[0])(found))


def test_information_is_that_of_the_present_policy_whatever_the_actions():
    state, batch = begin(), batch_of(KEY)._replace(action=0.9 * jnp.ones((32, ACTION)))
    directions = bac.scores(state.actor, batch, jnp.float32(0.25), config=CONFIG)
    found = bac.information(state.actor, batch, directions, jnp.float32(0.25), config=CONFIG)
    jacobian, flat = jacobians(state, batch), flat_scores(state, batch)
    fisher = np.mean(np.swapaxes(jacobian, 1, 2) @ jacobian, axis=0) / 0.25**2
    expected = flat @ fisher @ flat.T
    np.testing.assert_allclose(found @ found.T, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def test_gradient_is_that_of_the_dense_actor_critic():
    state, batch = begin(), batch_of(KEY)._replace(discount=jnp.tile(jnp.array([1.0, 0.0]), 16))
    moved, metrics = update(state, batch)
    # The policy that moves along the scores alone, in an orthonormal basis of their span.
    jacobian, flat = jacobians(state, batch), flat_scores(state, batch)
    span = np.linalg.svd(flat, full_matrices=False)[2]
    fisher = span @ (np.mean(np.swapaxes(jacobian, 1, 2) @ jacobian, axis=0) / 0.25**2) @ span.T
    fisher = fisher + gram.SHRINKAGE * np.diagonal(fisher).mean() * np.eye(len(fisher), dtype="f")
    own = jnp.asarray(flat @ span.T)
    discounts = 0.97 * batch.discount
    data = gptd.Transitions(
        batch.observation, own, batch.reward, discounts, batch.next_observation, jnp.zeros_like(own)
    )
    critic = gptd.fit(data, gptd.rbf(3.0, 100.0), jnp.asarray(fisher), noise=0.1, scale=1.0)
    expected = gptd.gradient(critic).mean
    found = -10.0 * ravel_pytree(moved.actor_optimiser.mu)[0]  # the first moment of Adam
    # In f32 the least of 32 directions are lost; `tests/bayes/test_gram.py` compares in f64.
    np.testing.assert_allclose(span @ found, expected, atol=0.06 * float(jnp.abs(expected).max()))
    np.testing.assert_allclose(metrics["gradient_norm"], jnp.linalg.norm(found), rtol=1e-3)
    np.testing.assert_allclose(metrics["gradient_norm"], jnp.linalg.norm(expected), rtol=5e-2)


@pytest.mark.parametrize(("spread", "shift"), [(1.0, 0.0), (3.0, 0.0), (1.0, 2.0), (0.3, 1.0)])
def test_the_gradient_is_the_present_policys_whichever_policy_chose_the_actions(spread, shift):
    """A reward c'a has the gradient mean_s J(s)'c; the actions lie `shift` sigmas from pi, `spread` sigmas wide."""
    config = dataclasses.replace(CONFIG, noise=(0.05,), batch=64)
    state, states = bac.init(KEY, OBSERVATION, ACTION, config=config), batch_of(KEY, 64)
    policy = bac.student(state.actor, states.observation, config=config)
    action = policy + 0.05 * (shift + spread * jax.random.normal(KEY, policy.shape))
    batch = states._replace(action=action, reward=10.0 * (action[:, 0] - action[:, 1]))
    moved, _ = bac.update(state, batch, KEY, config=config, hyper=from_config(config), step=jnp.float32(1e4))
    found = -10.0 * np.asarray(ravel_pytree(moved.actor_optimiser.mu)[0])
    exact = np.mean(np.array([10.0, -10.0]) @ jacobians(state, states), axis=0)
    length = np.linalg.norm(found) / np.linalg.norm(exact)
    assert found @ exact / np.linalg.norm(found) / np.linalg.norm(exact) > 0.97
    assert 0.8 < length < 1.2


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
