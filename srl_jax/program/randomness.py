"""Streams of randomness by name: a lane's numbers depend on its seed and condition, on the clock, and on what for."""

import zlib
from collections.abc import Sequence
from enum import IntEnum

import jax
import numpy as np

from srl_jax.program.lanes import Lane


class Stream(IntEnum):
    """What a key of one step of one lane is for. A new purpose gets a new number and disturbs no other."""

    ACT = 0
    RESET = 1
    LOT = 2
    BATCH = 3
    UPDATE = 4
    MIX = 5


def lane_keys(lanes: Sequence[Lane], stream: str) -> jax.Array:
    """Root keys key[n] of lanes for one stream of randomness.

    They depend on seed, task and damage only: lanes that differ in their algorithm share starts and noise, and a lane's
    numbers do not depend on which others run beside it.
    """
    seeds = np.array([lane.seed for lane in lanes], np.uint32)
    texts = [f"{lane.task}/{lane.damage}/{stream}" for lane in lanes]
    known = {text: zlib.crc32(text.encode()) for text in set(texts)}
    return _roots(seeds, np.array([known[text] for text in texts], np.uint32))


@jax.jit
def _roots(seeds: jax.Array, conditions: jax.Array) -> jax.Array:
    root = jax.random.key(0)
    return jax.vmap(lambda s, c: jax.random.fold_in(jax.random.fold_in(root, s), c))(seeds, conditions)


def at_step(keys: jax.Array, clock: jax.Array, stream: Stream) -> jax.Array:
    """Keys key[R] of one purpose at the clock i32[]."""
    return jax.vmap(lambda key: jax.random.fold_in(jax.random.fold_in(key, clock), stream))(keys)


def per_robot(keys: jax.Array, first: jax.Array | int, count: int) -> jax.Array:
    """Keys key[R, count] of consecutive robots or episodes, the first of them numbered `first`."""
    numbers = first + np.arange(count, dtype=np.int32)
    return jax.vmap(lambda key: jax.vmap(lambda n: jax.random.fold_in(key, n))(numbers))(keys)
