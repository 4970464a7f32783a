"""The controller: commits to a policy until the posterior is sure enough that another is better."""

from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp

from srl_jax.bayes import thompson
from srl_jax.types import GuidanceState


class Commitment(NamedTuple):
    """The switching threshold ``beta * psi ** refused``."""

    beta: jax.Array  # f32[] probability needed to switch at once
    psi: jax.Array  # f32[] decay of that threshold per refused switch


def init() -> GuidanceState:
    """A controller at the start of an episode: the student in command, no switch refused."""
    return GuidanceState(choice=jnp.zeros((), jnp.int32), refused=jnp.zeros((), jnp.int32))


def select(
    state: GuidanceState,
    draws: jax.Array,
    key: jax.Array,
    *,
    hyper: Commitment,
    estimator: str = "paired",
    switch_rule: str = "corrected",
    fallback: str = "previous",
) -> tuple[GuidanceState, jax.Array]:
    """Chooses whose action is taken (SRL, Raza et al. 2021, Sec. "Controller" and Alg. 1).

    Thompson's choice i* is followed if it is the policy j in command, or if
    ``P[Q(s, a_i*) > Q(s, a_j)] > beta * psi ** n`` with n the switches refused since the last one.

    Args:
        state: choice j and refusals n.
        draws: f32[M, N] posterior draws of Q for the N proposals at this state.
        key: random key.
        hyper: the threshold.
        estimator: see `thompson.probability_better`.
        switch_rule: ``acteach_release`` tests ``P[Q(s, a_j) > Q(s, a_i*)]`` instead, as AC-Teach's released code does.
        fallback: who acts after a refusal, the ``previous`` policy or the ``actor`` (proposal 0).

    Returns:
        The new state and the index i32[] of the policy that acts.
    """
    chex.assert_rank(draws, 2)
    proposed = thompson.choose(draws, key)
    new, old = (proposed, state.choice) if switch_rule == "corrected" else (state.choice, proposed)
    probability = thompson.probability_better(draws, new, old, estimator)
    switch = probability > hyper.beta * hyper.psi ** state.refused.astype(jnp.float32)
    same = proposed == state.choice
    refused = ~same & ~switch
    acting = jnp.where(refused, state.choice if fallback == "previous" else 0, proposed).astype(jnp.int32)
    count = jnp.where(refused, state.refused + 1, jnp.where(same, state.refused, 0))
    return GuidanceState(choice=acting, refused=count), acting
