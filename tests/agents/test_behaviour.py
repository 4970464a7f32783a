"""Cloning a scripted pi_B."""

from functools import partial

import chex
import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.ddpg import student
from srl_jax.config import DDPGConfig

CONFIG = DDPGConfig(hidden=(16, 16))


def teacher(observation: jax.Array) -> jax.Array:
    return 0.8 * jnp.stack([jnp.sin(2 * observation[0]), jnp.tanh(observation[1] - observation[2])])


OBSERVATIONS = jax.random.uniform(jax.random.key(1), (600, 3), minval=-1.0)
clone = jax.jit(partial(behaviour.clone, teacher, config=CONFIG, action_size=2), static_argnames="updates")


def test_cloning_reduces_the_error_and_imitates_where_it_was_not_fitted():
    _, before = clone(OBSERVATIONS, jax.random.key(0), updates=1)
    actor, after = clone(OBSERVATIONS, jax.random.key(0), updates=400)
    assert after < 0.02 * before and after < 4e-3
    fresh = jax.random.uniform(jax.random.key(2), (200, 3), minval=-0.9, maxval=0.9)
    error = behaviour.policy(actor, fresh, config=CONFIG) - jax.vmap(teacher)(fresh)
    assert np.sqrt(np.mean(np.square(error))) < 0.1


def test_reported_error_is_the_mean_square_over_all_observations():
    actor, error = clone(OBSERVATIONS, jax.random.key(3), updates=1)
    expected = np.mean((student(actor, OBSERVATIONS, config=CONFIG) - jax.vmap(teacher)(OBSERVATIONS)) ** 2)
    np.testing.assert_allclose(error, expected, rtol=1e-5)


def test_a_key_decides_the_clone():
    same, other = (clone(OBSERVATIONS, jax.random.key(k), updates=1)[0] for k in (3, 4))
    chex.assert_trees_all_equal(clone(OBSERVATIONS, jax.random.key(3), updates=1)[0], same)
    assert np.any(same["params"]["action"]["kernel"] != other["params"]["action"]["kernel"])


def test_a_frozen_student_is_a_teacher():
    actor, _ = clone(OBSERVATIONS, jax.random.key(0), updates=1)
    frozen = partial(behaviour.policy, actor, config=CONFIG)
    np.testing.assert_array_equal(frozen(OBSERVATIONS[0]), student(actor, OBSERVATIONS[0], config=CONFIG))
