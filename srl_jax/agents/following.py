"""What following a proposal from here on is worth: a critic with a head for each of the N + 1, on one torso.

Head i estimates ``Q_i(s, a) = E[sum_t gamma^t r_t]`` of action a, after which policy i acts for good, and with it
``V_i(s) = Q_i(s, pi_i(s))``. At 20 Hz a single action decides next to nothing, since the student acts at the next step
again; what is chosen between are policies. All heads learn off-policy from every transition, whoever acted, each by its
own policy's next action (general value functions: Sutton et al. 2011, "Horde"):

    y_i = r + gamma * discount * Q'_i(s', pi_i(s'))

with the target actor as pi_0 and teacher i as pi_i. Members, masks, priors and each member's data are those of the
critic with one head (Osband et al. 2016 and 2018), so that draws of V_i are paired: member and masks are the same.
"""

from collections.abc import Sequence

import chex
import jax
import jax.numpy as jnp

from srl_jax.agents import ensemble
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Teacher
from srl_jax.agents.settings import SRLConfig
from srl_jax.types import Params, Transition


def heads(config: SRLConfig, teachers: Sequence[Teacher]) -> int:
    """How many heads the critic has: N + 1, or 0 where it has the one value of a single action."""
    return 1 + len(teachers) if config.values == "policy" else 0


def own(q: jax.Array, *, config: SRLConfig) -> jax.Array:
    """The value of every proposal, from critics at the N actions of all: f32[..., N, N] of all heads -> f32[..., N].

    With one head, whose values f32[..., N] are of the actions alone, these are they.
    """
    if config.values == "action":
        return q
    chex.assert_equal(*q.shape[-2:])
    return jnp.diagonal(q, axis1=-2, axis2=-1)


def students(q: jax.Array, *, config: SRLConfig) -> jax.Array:
    """The student's head of f32[..., N], whose gradient the actor climbs; with one head, that."""
    return q[..., 0] if config.values == "policy" else q


def values(params: Params, observation: jax.Array, actions: jax.Array, *, config: SRLConfig) -> jax.Array:
    """V of every member and proposal without masks: f32[B, O], f32[B, N, A] -> f32[K, B, N]."""
    q = jax.vmap(lambda action: ensemble.q_values(params, observation, action, config=config), 1, 2)(actions)
    return own(q, config=config)


def td_target(
    target_critic: Params, batch: Transition, next_actions: jax.Array, *, config: SRLConfig, hyper: Hyper
) -> jax.Array:
    """What every member's heads learn to predict for a batch: f32[K, B, N], as `ensemble.td_target` head by head.

    Args:
        target_critic: parameters of the target ensemble.
        batch: transitions, leading axis B.
        next_actions: f32[B, N, A], of every policy at the next observation.
        config: static settings.
        hyper: numeric settings.
    """
    next_values = values(target_critic, batch.next_observation, next_actions, config=config)
    head = lambda value: ensemble.bootstrap(value, batch, config=config, hyper=hyper)  # noqa: E731
    return jax.vmap(head, -1, -1)(next_values)
