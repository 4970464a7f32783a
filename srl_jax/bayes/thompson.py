"""Decisions from posterior draws: Thompson's sample, and how probably one action is better than another."""

import jax
import jax.numpy as jnp

from srl_jax.distributions import normal


def choose(draws: jax.Array, key: jax.Array) -> jax.Array:
    """Thompson's choice: the best action under one posterior sample drawn at random.

    Args:
        draws: f32[M, N] posterior draws of Q for N actions.
        key: random key.

    Returns:
        i32[] index of the action.
    """
    sample = jax.random.randint(key, (), 0, draws.shape[0])
    return jnp.argmax(draws[sample]).astype(jnp.int32)


def paired_probability(difference: jax.Array) -> jax.Array:
    """``mean_m(1[D_m > 0] + 1/2 1[D_m = 0])`` of paired draws D: f32[M] -> f32[]."""
    return jnp.mean(jnp.where(difference == 0.0, 0.5, (difference > 0.0).astype(difference.dtype)))


def gaussian_probability(difference: jax.Array) -> jax.Array:
    """``Phi(mean(D) / std(D))`` of paired draws D: f32[M] -> f32[]; 0, 1/2 or 1 at zero variance, never NaN."""
    mean, variance = jnp.mean(difference), jnp.var(difference)
    certain = variance <= 0.0
    posterior = normal(mean, jnp.sqrt(jnp.where(certain, 1.0, variance)))
    return jnp.where(certain, 0.5 * (1.0 + jnp.sign(mean)), 1.0 - posterior.cdf(jnp.zeros_like(mean)))


def probability_better(
    draws: jax.Array, i: jax.Array | int, j: jax.Array | int, estimator: str = "paired"
) -> jax.Array:
    """Posterior probability that action i is better than action j, over the same samples for both.

    Args:
        draws: f32[M, N].
        i: i32[] index into N.
        j: i32[] index into N.
        estimator: ``paired`` counts the samples, ``gaussian`` fits a normal to the differences.

    Returns:
        f32[] in [0, 1]; ``p_ij + p_ji = 1``.

    Raises:
        ValueError: unknown estimator.
    """
    difference = draws[:, i] - draws[:, j]
    if estimator == "paired":
        return paired_probability(difference)
    if estimator == "gaussian":
        return gaussian_probability(difference)
    raise ValueError(f"estimator is {estimator!r}: choose paired or gaussian.")
