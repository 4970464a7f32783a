"""A ring buffer whose rows are whole transitions, packed into one matrix so that sampling is one gather."""

from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp

from srl_jax.types import Transition


class Replay(NamedTuple):
    """Capacity C of transitions of width W = 2 O + A + 4."""

    rows: jax.Array  # f32[C, W]


def width(observation_size: int, action_size: int) -> int:
    """Floats in one packed transition."""
    return 2 * observation_size + action_size + 4


def init(capacity: int, observation_size: int, action_size: int) -> Replay:
    """An empty buffer of `capacity` transitions (zeros; the caller counts what is filled)."""
    return Replay(jnp.zeros((capacity, width(observation_size, action_size)), jnp.float32))


def pack(transition: Transition) -> jax.Array:
    """A transition (any leading axes) as f32[..., W]."""
    t = transition
    scalars = jnp.stack([t.reward, t.discount, t.chosen, t.lot], axis=-1).astype(jnp.float32)
    return jnp.concatenate([t.observation, t.next_observation, t.action, scalars], axis=-1)


def unpack(rows: jax.Array, observation_size: int) -> Transition:
    """The transitions in f32[..., W]; inverse of `pack`."""
    o = observation_size
    return Transition(
        observation=rows[..., :o],
        next_observation=rows[..., o : 2 * o],
        action=rows[..., 2 * o : -4],
        reward=rows[..., -4],
        discount=rows[..., -3],
        chosen=rows[..., -2],
        lot=rows[..., -1],
    )


def add(replay: Replay, transition: Transition, at: jax.Array, wanted: jax.Array | bool = True) -> Replay:
    """Writes E transitions at the rows that follow write number `at`; leading axes are buffers that advance together.

    The leading axes are there because `vmap` makes a scatter of the write, at half its speed.

    Args:
        replay: rows f32[..., C, W], the capacity C a multiple of E.
        transition: leading axes [..., E].
        at: i32[] number of rows ever written to each, a multiple of E; wraps around at C.
        wanted: bool[...] False writes back what is there; to choose between two buffers would copy them whole.
    """
    rows, new = replay.rows, pack(transition)
    chex.assert_equal_rank([rows, new])
    chex.assert_equal(new.shape[-1], rows.shape[-1])
    start = at % rows.shape[-2]
    old = jax.lax.dynamic_slice_in_dim(rows, start, new.shape[-2], axis=-2)
    new = jnp.where(jnp.asarray(wanted)[..., None, None], new, old)
    return Replay(jax.lax.dynamic_update_slice_in_dim(rows, new, start, axis=-2))


def draw(replay: Replay, filled: jax.Array, n: int, key: jax.Array) -> jax.Array:
    """Draws n packed transitions f32[n, W] uniformly, with replacement, from the first `filled` rows.

    With replacement, since `choice(replace=False)` costs 250 times as much and batches are far smaller than buffers.
    """
    return replay.rows[jax.random.randint(key, (n,), 0, jnp.maximum(filled, 1))]


def sample(replay: Replay, filled: jax.Array, n: int, key: jax.Array, observation_size: int) -> Transition:
    """`draw`, unpacked: transitions with a leading axis n."""
    return unpack(draw(replay, filled, n, key), observation_size)
