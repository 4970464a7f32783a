"""Policies that were never trained, for tests of what becomes of policies."""

from functools import partial

import jax
import numpy as np

from srl_jax.agents import ddpg
from srl_jax.agents.settings import DDPGConfig
from srl_jax.portable import Policy
from srl_jax.portable.policy import layers

OBSERVATION = [("clock", 2), ("joints", 5)]


def acting(layer_norm=True, hidden=(16, 8), **about):
    """A policy f32[7] -> f32[3], and the same as jax has it, of many observations."""
    config = DDPGConfig(hidden=hidden, layer_norm=layer_norm)
    actor = ddpg.init(jax.random.key(1), 7, 3, config=config).actor
    moved = jax.tree.map(lambda x: x + 0.3 * jax.random.normal(jax.random.key(x.size), x.shape), actor)
    student = jax.vmap(partial(ddpg.student, moved, config=config))
    return Policy(layers(moved), {"observation": OBSERVATION} | about), lambda seen: np.asarray(student(seen))


def policy(layer_norm=True, hidden=(16, 8), **about):
    """A policy f32[7] -> f32[3]."""
    return acting(layer_norm, hidden, **about)[0]
