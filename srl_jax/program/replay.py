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


class Replay(NamedTuple):
    """N vector steps of E robots; step t lies in row ``t mod N``. A capacity is ``C = N E`` transitions."""

    moves: jax.Array  # f16[N, E, O + A] observation and action
    facts: jax.Array  # f32[N, E, 5] reward, discount, chosen, lot, and 1 where time cut the episode off
    ends: jax.Array  # f16[M, E, O] what was reached where it was cut; step t of a robot has row ``t // T mod M``


def init(capacity: int, environments: int, episode_steps: int, observation_size: int, action_size: int) -> Replay:
    """An empty buffer (zeros; the caller counts what is filled).

    Args:
        capacity: transitions, a multiple of `environments`.
        environments: robots that step together (E).
        episode_steps: steps after which time cuts an episode off (T): of T steps in a row at most one does.
        observation_size: O.
        action_size: A.
    """
    chex.assert_is_divisible(capacity, environments)
    steps = capacity // environments
    windows = steps // episode_steps + 2
    return Replay(
        moves=jnp.zeros((steps, environments, observation_size + action_size), KEPT),
        facts=jnp.zeros((steps, environments, len(FACTS) + 1), jnp.float32),
        ends=jnp.zeros((windows, environments, observation_size), KEPT),
    )


def size(capacity: int, environments: int, episode_steps: int, observation_size: int, action_size: int) -> int:
    """Bytes of such a buffer."""
    shapes = jax.eval_shape(lambda: init(capacity, environments, episode_steps, observation_size, action_size))
    return sum(leaf.size * leaf.dtype.itemsize for leaf in shapes)


def add(
    replay: Replay,
    transition: Transition,
    cut: jax.Array,
    step: jax.Array,
    *,
    episode_steps: int,
    wanted: jax.Array | bool = True,
) -> Replay:
    """Writes one vector step; leading axes are buffers that advance together.

    The leading axes are there because `vmap` makes a scatter of the write, at half its speed.

    Args:
        replay: leaves [..., N, E, W].
        transition: leading axes [..., E].
        cut: bool[..., E] where time has ended the episode.
        step: i32[] number of vector steps ever written to each (t); wraps around at N.
        episode_steps: T, as in `init`.
        wanted: bool[...] False writes back what is there; to choose between two buffers would copy them whole.
    """
    moves = _kept(jnp.concatenate([transition.observation, transition.action], axis=-1))
    facts = jnp.stack([*(getattr(transition, name) for name in FACTS), cut], axis=-1).astype(jnp.float32)
    wanted = jnp.broadcast_to(wanted, cut.shape[:-1])[..., None, None]
    window = step // episode_steps
    return Replay(
        moves=_write(replay.moves, moves, step, wanted),
        facts=_write(replay.facts, facts, step, wanted),
        ends=_write(replay.ends, _kept(transition.next_observation), window, wanted & cut[..., None]),
    )


def _kept(values: jax.Array) -> jax.Array:
    largest = float(jnp.finfo(KEPT).max)
    return jnp.clip(values, -largest, largest).astype(KEPT)


def _write(rows: jax.Array, new: jax.Array, at: jax.Array, wanted: jax.Array) -> jax.Array:
    """rows [..., N, E, W] with new [..., E, W] in row ``at mod N``, where it is wanted."""
    at = at % rows.shape[-3]
    old = jax.lax.dynamic_index_in_dim(rows, at, axis=-3, keepdims=False)
    return jax.lax.dynamic_update_index_in_dim(rows, jnp.where(wanted, new, old), at, axis=-3)


def draw(
    replay: Replay, latest: jax.Array, step: jax.Array, n: int, key: jax.Array, *, episode_steps: int
) -> Transition:
    """Draws n transitions uniformly, with replacement, from the filled part of one buffer.

    With replacement, since `choice(replace=False)` costs 250 times as much and batches are far smaller than buffers.

    Args:
        replay: one buffer.
        latest: f32[E, O] what the last step has reached, or where a new episode starts from.
        step: i32[] number of vector steps ever written (t).
        n: transitions.
        key: random key.
        episode_steps: T, as in `init`.
    """
    steps, environments = replay.moves.shape[:2]
    filled = jnp.clip(step, 1, steps) * environments
    index = jax.random.randint(key, (n,), 0, filled)
    return take(replay, index, latest, step, episode_steps=episode_steps)


def take(replay: Replay, index: jax.Array, latest: jax.Array, step: jax.Array, *, episode_steps: int) -> Transition:
    """The transitions at places i32[n] of a buffer, robot ``index mod E`` in row ``index // E``; as `draw`."""
    steps, environments = replay.moves.shape[:2]
    row, robot = index // environments, index % environments
    age = (step - 1 - row) % steps  # vector steps since it was written
    window = (step - 1 - age) // episode_steps % replay.ends.shape[0]
    moves, facts = replay.moves[row, robot], replay.facts[row, robot]
    size = latest.shape[-1]
    following = replay.moves[(row + 1) % steps, robot][:, :size].astype(jnp.float32)
    following = jnp.where((age == 0)[:, None], latest[robot], following)
    cut = replay.ends[window, robot].astype(jnp.float32)
    return Transition(
        observation=moves[:, :size].astype(jnp.float32),
        action=moves[:, size:].astype(jnp.float32),
        next_observation=jnp.where(facts[:, -1:] > 0, cut, following),
        **{name: facts[:, place] for place, name in enumerate(FACTS)},
    )
