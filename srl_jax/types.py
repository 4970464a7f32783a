"""Tuples shared by every module; unbatched, a lane (and an environment) adds leading axes."""

from typing import Any, NamedTuple

import jax

Params = Any  # a pytree of network parameters


class Transition(NamedTuple):
    """One step of experience, as an off-policy update sees it."""

    observation: jax.Array  # f32[O]
    action: jax.Array  # f32[A] in [-1, 1], as executed (noise included)
    reward: jax.Array  # f32[]
    discount: jax.Array  # f32[] 0 on termination, 1 on time-out and in between
    next_observation: jax.Array  # f32[O] before any auto-reset
    chosen: jax.Array  # f32[] 0 student, 1.. teachers (kept as a float: rows of a replay are one matrix)
    lot: jax.Array  # f32[] whole number below 2^24, drawn once: what an agent draws from it stays with the transition


class GuidanceState(NamedTuple):
    """What the controller remembers between two decisions of one environment."""

    choice: jax.Array  # i32[] index of the policy in command: 0 student, 1.. teachers
    refused: jax.Array  # i32[] switches refused since the last switch or reset (n in the switching rule)


class ActState(NamedTuple):
    """What acting carries from step to step in one environment."""

    noise: jax.Array  # f32[A] correlated exploration noise, unit variance
    guidance: GuidanceState
    seed: jax.Array | None = None  # u32[] of the episode, for agents that draw something once an episode
    age: jax.Array | None = None  # i32[] control steps since the episode began, told to agents that are `timed`


class EndedEpisodes(NamedTuple):
    """The episodes that robots have ended at one step, for agents that learn from whole episodes."""

    ended: jax.Array  # bool[] False: still under way (or not to be learned from), and the rest means nothing
    seed: jax.Array  # u32[] as in `ActState`
    returns: jax.Array  # f32[] sum of rewards
    distance: jax.Array  # f32[] m come closer, as the task counts it
    began: jax.Array  # i32[] the lane's control step at which it began
    now: jax.Array  # i32[] and the one at which it ended
