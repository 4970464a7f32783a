"""Who walks: the policy that is best under the posterior, and how long it is kept.

``greedy`` is the Bayes-optimal choice for one decision, the best mean; ``thompson`` takes the best of one draw of the
posterior (posterior sampling, Strens 2000), which also explores. Both know belief, matrix and trials (`trials`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

RULES = ("greedy", "thompson", "likeliest", "uniform")


class Choice(NamedTuple):
    """Who is in command, for how long, and where that began."""

    policy: jax.Array  # i32[]
    held: jax.Array  # i32[] control steps of this segment
    begun: jax.Array  # f32[] m come when the segment began to count


class Pace(NamedTuple):
    """How long a choice is kept."""

    hold: int = 30  # control steps of a segment: a second and a half
    settle: int = 10  # of them at its beginning that do not count: the change of gait
    margin: float = 0.1  # share of the healthy speed by which another must be better to take over at once
    tipping: float = 0.7  # cosine of the tilt below which a segment is broken off
    toll: float = -0.5  # share of the healthy speed that a policy is taken to be worth under which the robot tips


PACE = Pace()


def proposals(mean: jax.Array, draw: jax.Array, likeliest: jax.Array, admitted: jax.Array, key: jax.Array) -> jax.Array:
    """Whom each of `RULES` names, i32[4]; all at once, so that one program serves all rules.

    Args:
        mean: f32[I] of the posterior over what policies are worth.
        draw: f32[I] of it.
        likeliest: f32[I] what they are worth under the likeliest damage.
        admitted: bool[I] policies to choose from.
        key: random key.
    """
    best = [jnp.argmax(jnp.where(admitted, worth, -jnp.inf)).astype(jnp.int32) for worth in (mean, draw, likeliest)]
    return jnp.stack([*best, jax.random.categorical(key, jnp.where(admitted, 0.0, -jnp.inf)).astype(jnp.int32)])


def segment(choice: Choice, come: jax.Array, pace: Pace) -> tuple[Choice, jax.Array, jax.Array]:
    """The choice one control step later, whether its segment is over, and its m a step (NaN while it is not)."""
    held = choice.held + 1
    begun = jnp.where(held <= pace.settle, come, choice.begun)
    over = held >= pace.hold
    walked = (come - begun) / (pace.hold - pace.settle)
    return Choice(choice.policy, held, begun), over, jnp.where(over, walked, jnp.nan)


def decide(
    choice: Choice,
    over: jax.Array,
    proposed: jax.Array,
    mean: jax.Array,
    admitted: jax.Array,
    open_minded: jax.Array,
    pace: Pace,
) -> Choice:
    """Who walks on: the proposed one where a segment is over, or at once where the present one is clearly worse.

    Where it is rather none of the damages and something was tried, segments are walked to their end: they tell more
    than the belief.

    Args:
        choice: who is in command.
        over: bool[] its segment.
        proposed: i32[] who is to be.
        mean: f32[I] what policies are expected to be worth.
        admitted: bool[I].
        open_minded: bool[] whether a segment may be broken off for what is expected of another policy.
        pace: how long choices are kept.
    """
    behind = jnp.max(jnp.where(admitted, mean, -jnp.inf)) - mean[choice.policy]
    change = over | ((behind > pace.margin) & open_minded)
    return Choice(
        jnp.where(change, proposed, choice.policy),
        jnp.where(change, 0, choice.held),
        jnp.where(change, jnp.nan, choice.begun),
    )


def number(rule: str) -> int:
    """A rule's index into `RULES`.

    Raises:
        ValueError: there is none of that name.
    """
    if rule not in RULES:
        raise ValueError(f"rule is {rule!r}: choose one of {', '.join(RULES)}.")
    return RULES.index(rule)
