"""A posterior over critics: an ensemble of networks, each under explicit dropout masks.

A posterior sample is (member, one mask per hidden layer), drawn once for every action that is compared, after
Gal & Ghahramani (2016) for the masks and Lakshminarayanan et al. (2017) for the members.
"""

from collections.abc import Callable, Sequence

import chex
import jax
import jax.numpy as jnp

from srl_jax.distributions import bernoulli
from srl_jax.types import Params

Critic = Callable[..., jax.Array]  # (params, observation, action, masks) -> f32[]


def sample_masks(key: jax.Array, widths: Sequence[int], shape: tuple[int, ...], rate: jax.Array) -> tuple:
    """Draws inverted-dropout masks.

    Args:
        key: random key.
        widths: hidden widths H_l of the critic.
        shape: leading axes, typically (members K, masks per member J).
        rate: f32[] probability of dropping a unit, in [0, 1).

    Returns:
        One f32[*shape, H_l] per hidden layer, with entries 0 or 1 / (1 - rate).
    """
    keep = 1.0 - rate
    keys = jax.random.split(key, len(widths))
    return tuple(
        bernoulli(keep).sample(seed=k, sample_shape=(*shape, width)) / keep
        for k, width in zip(keys, widths, strict=True)
    )


def q_draws(critic: Critic, params: Params, observation: jax.Array, actions: jax.Array, masks: tuple) -> jax.Array:
    """Posterior draws of Q(s, a) for several actions, every draw applied to all of them.

    Args:
        critic: unbatched network, ``(params, observation, action, masks) -> f32[]``, or f32[H] of several values.
        params: ensemble parameters with a leading axis K.
        observation: f32[O].
        actions: f32[N, A] proposals.
        masks: per hidden layer f32[K, J, H], or f32[K, J, N, H] for masks of their own per proposal.

    Returns:
        f32[K * J, N] (f32[K * J, N, H]); row m is one posterior sample, ordered so that consecutive rows change the
        member first.
    """
    chex.assert_rank([observation, actions], [1, 2])
    own_masks = masks[0].ndim == 4
    over_actions = jax.vmap(critic, (None, None, 0, 0 if own_masks else None))
    over_masks = jax.vmap(over_actions, (None, None, None, 0))
    over_members = jax.vmap(over_masks, (0, None, None, 0))
    draws = over_members(params, observation, actions, masks)
    return jnp.swapaxes(draws, 0, 1).reshape(-1, *draws.shape[2:])


def mean_q(critic: Critic, params: Params, observation: jax.Array, action: jax.Array) -> jax.Array:
    """The ensemble's mean network (no mask) at one state and action: f32[], or f32[H] of several values."""
    return jnp.mean(jax.vmap(critic, (0, None, None, None))(params, observation, action, None), axis=0)
