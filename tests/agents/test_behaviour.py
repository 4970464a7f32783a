"""Cloning a scripted pi_B."""

from functools import partial

import chex
import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.ddpg import student
from srl_jax.agents.settings import DDPGConfig

CONFIG = DDPGConfig(hidden=(16, 16))


def teacher(observation: jax.Array) -> jax.Array:
    return 0.8 * jnp.stack([jnp.sin(2 * observation[0]), jnp.tanh(observation[1] - observation[2])])


OBSERVATIONS = jax.random.uniform(jax.random.key(1), (600, 3), minval=-1.0)
clone = jax.jit(partial(behaviour.clone, teacher, config=CONFIG, updates=300, action_size=2))
policy = jax.jit(partial(behaviour.policy, config=CONFIG))


def test_cloning_imitates_even_where_it_was_not_fitted():
    actor, error = clone(OBSERVATIONS, jax.random.key(0))
    advice = jax.vmap(teacher)(OBSERVATIONS)
    still = np.mean(np.square(advice))  # the error of a fresh actor, which hardly moves
    assert error < 0.02 * still
    np.testing.assert_allclose(error, np.mean(np.square(policy(actor, OBSERVATIONS) - advice)), rtol=1e-4)
    fresh = jax.random.uniform(jax.random.key(2), (600, 3), minval=-0.9, maxval=0.9)
    assert np.sqrt(np.mean(np.square(policy(actor, fresh) - jax.vmap(teacher)(fresh)))) < 0.1


def test_a_key_decides_the_clone():
    first, same, other = (clone(OBSERVATIONS, jax.random.key(k))[0] for k in (3, 3, 4))
    chex.assert_trees_all_equal(first, same)
    assert np.any(first["params"]["action"]["kernel"] != other["params"]["action"]["kernel"])


def test_a_frozen_student_is_a_teacher():
    actor, _ = clone(OBSERVATIONS, jax.random.key(0))
    own = jax.jit(partial(student, config=CONFIG))(actor, OBSERVATIONS)
    np.testing.assert_array_equal(policy(actor, OBSERVATIONS), own)
