"""A ring buffer that holds every observation once: what a step reached is what the robot's next step starts from.

Where an episode is cut off by time, the next step starts a new one, and the observation that was reached is kept apart.
Where it ends in success or a fall, its value does not count (its discount is 0), and the new start stands in for it.
"""

from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp

from srl_jax.types import Transition

KEPT = jnp.float16  # 3 digits: finer than any encoder of the robot, at half the memory and half the cache lines
FACTS = ("reward", "discount", "chosen", "lot")


class Sizes(NamedTuple):
    """What a buffer's words stand for."""

    observation: int
    action: int
    episode_steps: int  # steps after which time cuts an episode off (T): of T steps in a row at most one does


class Replay(NamedTuple):
    """N vector steps of E robots, ``C = N E`` transitions; step t lies in row ``t mod N``.

    Two numbers of half precision share a word: a gather takes as long for a word as for a half.
    """

    moves: jax.Array  # u32[N, E, W + V] observation (W words) and action (V words)
    facts: jax.Array  # f32[N, E, 5] reward, discount, chosen, lot, and 1 where time cut the episode off
    ends: jax.Array  # u32[M, E, W] what was reached where it was cut; step t of a robot has row ``t // T mod M``
    latest: jax.Array  # u32[E, W] what the next step will start from


def init(capacity: int, environments: int, sizes: Sizes) -> Replay:
    """An empty buffer (zeros; the caller counts what is filled).

    Args:
        capacity: transitions, a multiple of `environments`.
        environments: robots that step together (E).
        sizes: of what is stored.
    """
    chex.assert_is_divisible(capacity, environments)
    steps, seen = capacity // environments, _words(sizes.observation)
    return Replay(
        moves=jnp.zeros((steps, environments, seen + _words(sizes.action)), jnp.uint32),
        facts=jnp.zeros((steps, environments, len(FACTS) + 1), jnp.float32),
        ends=jnp.zeros((steps // sizes.episode_steps + 2, environments, seen), jnp.uint32),
        latest=jnp.zeros((environments, seen), jnp.uint32),
    )


def _words(numbers: int) -> int:
    return -(-numbers // 2)


def _packed(values: jax.Array) -> jax.Array:
    """f32[..., n] as words u32[..., (n + 1) // 2]."""
    largest, odd = float(jnp.finfo(KEPT).max), values.shape[-1] % 2
    values = jnp.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, odd)])
    halves = jnp.clip(values, -largest, largest).astype(KEPT)
    return jax.lax.bitcast_convert_type(halves.reshape(*values.shape[:-1], -1, 2), jnp.uint32)


def _unpacked(words: jax.Array, numbers: int) -> jax.Array:
    halves = jax.lax.bitcast_convert_type(words, KEPT)
    return halves.reshape(*words.shape[:-1], -1)[..., :numbers].astype(jnp.float32)


def size(capacity: int, environments: int, sizes: Sizes) -> int:
    """Bytes of such a buffer."""
    shapes = jax.eval_shape(lambda: init(capacity, environments, sizes))
    return sum(leaf.size * leaf.dtype.itemsize for leaf in shapes)


def add(
    replay: Replay,
    transition: Transition,
    cut: jax.Array,
    latest: jax.Array,
    step: jax.Array,
    *,
    episode_steps: int,
    wanted: jax.Array | bool = True,
) -> Replay:
    """Writes one vector step; leading axes are buffers that advance together.

    The leading axes are there because `vmap` makes a scatter of the write, at half its speed.

    Args:
        replay: leaves [..., N, E, words].
        transition: leading axes [..., E].
        cut: bool[..., E] where time has ended the episode.
        latest: f32[..., E, O] what the next step will start from.
        step: i32[] number of vector steps ever written to each (t); wraps around at N.
        episode_steps: T of `Sizes`.
        wanted: bool[...] False writes back what is there; to choose between two buffers would copy them whole.
    """
    wanted = jnp.broadcast_to(wanted, cut.shape[:-1])[..., None, None]
    moves = jnp.concatenate([_packed(transition.observation), _packed(transition.action)], axis=-1)
    facts = jnp.stack([*(getattr(transition, name) for name in FACTS), cut], axis=-1).astype(jnp.float32)
    reached, window = _packed(transition.next_observation), step // episode_steps
    return Replay(
        moves=_write(replay.moves, moves, step, wanted),
        facts=_write(replay.facts, facts, step, wanted),
        ends=_write(replay.ends, reached, window, wanted & cut[..., None]),
        latest=jnp.where(wanted, _packed(latest), replay.latest),
    )


def _write(rows: jax.Array, new: jax.Array, at: jax.Array, wanted: jax.Array) -> jax.Array:
    """rows [..., N, E, W] with new [..., E, W] in row ``at mod N``, where it is wanted."""
    at = at % rows.shape[-3]
    old = jax.lax.dynamic_index_in_dim(rows, at, axis=-3, keepdims=False)
    return jax.lax.dynamic_update_index_in_dim(rows, jnp.where(wanted, new, old), at, axis=-3)


def draw(replay: Replay, step: jax.Array, n: int, key: jax.Array, sizes: Sizes) -> Transition:
    """Draws n transitions uniformly, with replacement, from the filled part of one buffer.

    With replacement, since `choice(replace=False)` costs 250 times as much and batches are far smaller than buffers.

    Args:
        replay: one buffer.
        step: i32[] number of vector steps ever written (t).
        n: transitions.
        key: random key.
        sizes: of what is stored.
    """
    steps, environments = replay.facts.shape[:2]
    filled = jnp.clip(step, 1, steps) * environments
    return take(replay, jax.random.randint(key, (n,), 0, filled), step, sizes)


def take(replay: Replay, index: jax.Array, step: jax.Array, sizes: Sizes) -> Transition:
    """The transitions at places i32[n] of a buffer, robot ``index mod E`` in row ``index // E``; as `draw`."""
    steps, environments = replay.facts.shape[:2]
    seen, windows = _words(sizes.observation), replay.ends.shape[0]
    row, robot = index // environments, index % environments
    moves, facts = replay.moves[row, robot], replay.facts[row, robot]
    following = replay.moves[(row + 1) % steps, robot, :seen]

    age, cut = (step - 1 - row) % steps, facts[:, -1] > 0  # vector steps since it was written
    beyond = jnp.concatenate([replay.ends, replay.latest[None]])
    place = jnp.where(cut, (step - 1 - age) // sizes.episode_steps % windows, windows)
    following = jnp.where((cut | (age == 0))[:, None], beyond[place, robot], following)
    return Transition(
        observation=_unpacked(moves[:, :seen], sizes.observation),
        action=_unpacked(moves[:, seen:], sizes.action),
        next_observation=_unpacked(following, sizes.observation),
        **{name: facts[:, place] for place, name in enumerate(FACTS)},
    )
