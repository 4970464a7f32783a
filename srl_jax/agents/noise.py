"""Exploration noise that is correlated from step to step: an AR(1) process of unit variance, and a scale that decays.

With correlation it is the discrete form of the Ornstein-Uhlenbeck process of DDPG (Lillicrap et al. 2016).
"""

import jax
import jax.numpy as jnp

from srl_jax.agents.hyper import Hyper
from srl_jax.distributions import normal
from srl_jax.types import ActState


def start(key: jax.Array, action_size: int) -> jax.Array:
    """The noise f32[A] that an episode starts with, drawn from the process's stationary distribution N(0, 1).

    Begun at zero, the first steps of every episode would explore at half the size.
    """
    return jax.random.normal(key, (action_size,))


def scale(hyper: Hyper, step: jax.Array) -> jax.Array:
    """Standard deviation: ``sigma_t^2 = sigma_0^2 decay^t``, not below the floor unless it began there."""
    floor = jnp.minimum(hyper.noise_floor, hyper.noise)
    return jnp.maximum(hyper.noise * hyper.noise_decay ** (0.5 * step), floor)


def explore(
    action: jax.Array, act_state: ActState, key: jax.Array, *, hyper: Hyper, step: jax.Array
) -> tuple[jax.Array, ActState]:
    """An action with noise of unit-variance AR(1) form, scaled by `scale`, and the state that carries it on.

    Args:
        action: f32[A] in [-1, 1].
        act_state: whose ``noise`` f32[A] is the last step's.
        key: random key.
        hyper: with `noise`, `noise_decay`, `noise_floor` and `noise_correlation`.
        step: f32[] environment steps taken so far by the lane.

    Returns:
        The action f32[A], clipped to [-1, 1], and the new act_state.
    """
    rho = hyper.noise_correlation
    noise = normal(rho * act_state.noise, jnp.sqrt(1.0 - rho**2)).sample(seed=key)
    return jnp.clip(action + scale(hyper, step) * noise, -1.0, 1.0), act_state._replace(noise=noise)
