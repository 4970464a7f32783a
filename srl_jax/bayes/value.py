"""The healthy value V_B: how surely and how soon pi_B reaches a goal; truncated episodes are censored, not failed.

What it is, its closed form, and its estimate by counting from one start; `value_network` has it at any state.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike


class HealthyEpisodes(NamedTuple):
    """N healthy rollouts of at most T steps; rows of an episode after its end are ignored."""

    observation: jax.Array  # f32[N, T + 1, O] the start, then what each step reached (before any reset)
    length: jax.Array  # i32[N] steps until the episode ended, 1..T
    success: jax.Array  # bool[N] the last step reached a goal: t_g = length
    failure: jax.Array  # bool[N] the last step made it impossible (a fall); neither: truncated


class HealthyValue(NamedTuple):
    """V_B and its two factors."""

    success: jax.Array  # f32[] P(X_g)
    discount: jax.Array  # f32[] E[gamma^(t_g - 1) | X_g], in [0, 1]
    steps: jax.Array  # f32[] the one t_g with that discount; at most E[t_g | X_g], inf where nothing succeeds
    value: jax.Array  # f32[] success * discount / (1 - gamma)


def healthy_episodes(
    observation: ArrayLike, length: ArrayLike, success: ArrayLike, failure: ArrayLike
) -> HealthyEpisodes:
    """Checks rollouts and makes them one tuple; the shapes are those of `HealthyEpisodes`.

    Raises:
        ValueError: there is no episode, shapes disagree, a length lies outside 1..T, an episode both succeeds and
            fails, or an observation up to its end is not finite.
    """
    x, steps = np.asarray(observation, np.float32), np.asarray(length)
    won, lost = np.asarray(success, bool), np.asarray(failure, bool)
    if x.ndim != 3 or x.shape[0] < 1 or x.shape[1] < 2:
        raise ValueError(f"observation has shape {x.shape}; it must be [N, T + 1, O] with N and T at least 1.")
    for name, array in (("length", steps), ("success", won), ("failure", lost)):
        if array.shape != x.shape[:1]:
            raise ValueError(f"{name} has shape {array.shape}; it must be [{len(x)}], one for each episode.")
    if steps.min() < 1 or steps.max() >= x.shape[1]:
        raise ValueError(f"length lies in {steps.min()}..{steps.max()}; it must lie in 1..{x.shape[1] - 1}.")
    if np.any(won & lost):
        raise ValueError(f"{int((won & lost).sum())} episodes both succeed and fail; say which came first.")
    if not np.all(np.isfinite(x).all(-1) | (np.arange(x.shape[1]) > steps[:, None])):
        raise ValueError("observation is not finite everywhere up to an episode's end; leave such episodes out.")
    return HealthyEpisodes(jnp.asarray(x), jnp.asarray(steps, jnp.int32), jnp.asarray(won), jnp.asarray(lost))


def combine(success: jax.Array, discount: jax.Array, gamma: jax.Array | float) -> HealthyValue:
    """``V_B = P(X_g) E[gamma^(t_g - 1) | X_g] / (1 - gamma)`` (SRL, Raza et al. 2021, Sec. "Healthy Ensembles").

    The expectation is conditional on success: the unconditional one of the text would count failed runs twice.
    """
    steps = 1.0 + jnp.log(discount) / jnp.log(gamma)
    return HealthyValue(success, discount, steps, success * discount / (1.0 - gamma))


def _ratio(part: jax.Array, whole: jax.Array) -> jax.Array:
    return jnp.where(whole > 0.0, part / jnp.where(whole > 0.0, whole, 1.0), 0.0)


def constant_hazard(p: jax.Array, f: jax.Array, gamma: jax.Array | float) -> HealthyValue:
    """The exact value where each step succeeds with probability p and fails with f: ``p / ((1-g)(1 - g(1-p-f)))``."""
    success, reached = _ratio(p, p + f), p / (1.0 - gamma * (1.0 - p - f))
    return combine(success, _ratio(reached, success), gamma)


def product_limit(data: HealthyEpisodes, *, gamma: jax.Array | float) -> tuple[HealthyValue, jax.Array]:
    """V_B of the episodes' start by the estimator of competing risks (Aalen & Johansen 1978).

    Step k's hazards are the shares that succeed and fail at k among episodes still observed there: a truncated episode
    counts until its end, then not at all. Without truncation these are plain frequencies. Consistent if truncation does
    not depend on what would have followed. Beside the value stands the probability f32[] of being undecided when no
    episode is observed any more: P(X_g) lies between ``success`` and ``success`` plus that.
    """
    step = jnp.arange(1, data.observation.shape[1])
    at_risk = jnp.sum(data.length[:, None] >= step[None], axis=0)
    ends = (data.length[:, None] == step[None]).astype(jnp.float32)
    wins, losses = (_ratio(jnp.sum(ends * x[:, None], axis=0), at_risk) for x in (data.success, data.failure))
    going = jnp.cumprod(1.0 - wins - losses)
    reached = jnp.concatenate([jnp.ones(1), going[:-1]]) * wins
    success = jnp.sum(reached)
    discounted = jnp.sum(reached * jnp.asarray(gamma) ** (step - 1.0))
    return combine(success, _ratio(discounted, success), gamma), going[-1]
