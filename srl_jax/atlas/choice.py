"""Who walks: the policy that is best under the posterior over damages, and how long it is kept.

``greedy`` is the Bayes-optimal choice for one decision, ``argmax_i sum_d b(d) P[i, d]``; ``thompson`` draws a damage
and takes the best policy for it (posterior sampling, Strens 2000), which also explores.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

RULES = ("greedy", "thompson", "likeliest", "uniform")


class Choice(NamedTuple):
    """Who is in command, and since when."""

    policy: jax.Array  # i32[]
    held: jax.Array  # i32[] control steps since it took over


def values(log_belief: jax.Array, matrix: jax.Array) -> jax.Array:
    """What every policy is expected to walk f32[I], from log-probabilities f32[D + 1] and the matrix f32[I, D].

    'None of these' says nothing of any policy: the rest of the belief speaks for it.
    """
    known = jnp.exp(log_belief[:-1])
    return matrix @ (known / jnp.maximum(jnp.sum(known), 1e-12))


def propose(
    log_belief: jax.Array, matrix: jax.Array, admitted: jax.Array, key: jax.Array, rule: jax.Array | int
) -> jax.Array:
    """The policy i32[] that a rule names; a value, so that one program serves all rules.

    Args:
        log_belief: f32[D + 1].
        matrix: f32[I, D] what policy i is worth under damage d.
        admitted: bool[I] policies to choose from.
        key: random key.
        rule: i32[] index into `RULES`: greedy; thompson; likeliest, the best for the likeliest damage; uniform, any.
    """
    known = log_belief[:-1]
    greedy = _best(values(log_belief, matrix), admitted)
    thompson = _best(matrix[:, jax.random.categorical(key, known)], admitted)
    likeliest = _best(matrix[:, jnp.argmax(known)], admitted)
    uniform = jax.random.categorical(key, jnp.where(admitted, 0.0, -jnp.inf)).astype(jnp.int32)
    return jnp.stack([greedy, thompson, likeliest, uniform])[rule]


def number(rule: str) -> int:
    """A rule's index into `RULES`.

    Raises:
        ValueError: there is none of that name.
    """
    if rule not in RULES:
        raise ValueError(f"rule is {rule!r}: choose one of {', '.join(RULES)}.")
    return RULES.index(rule)


def _best(worth: jax.Array, admitted: jax.Array) -> jax.Array:
    return jnp.argmax(jnp.where(admitted, worth, -jnp.inf)).astype(jnp.int32)


def commit(choice: Choice, proposed: jax.Array, expected: jax.Array, *, hold: int, margin: float) -> Choice:
    """Changes policy where the one in command is expected to be worse by more than `margin`, or was held long enough.

    Args:
        choice: who is in command.
        proposed: i32[] who is to be.
        expected: f32[I] see `values`, as shares of the healthy speed.
        hold: control steps that a choice is kept unless it is worse by the margin.
        margin: share of the healthy speed.
    """
    worse = expected[proposed] - expected[choice.policy] > margin
    change = (proposed != choice.policy) & (worse | (choice.held >= hold))
    return Choice(jnp.where(change, proposed, choice.policy), jnp.where(change, 0, choice.held + 1))
