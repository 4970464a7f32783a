"""The one door to distrax: its import warns about deprecated names in a dependency and takes a second."""

import warnings

import jax
import jax.numpy as jnp

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import distrax


def normal(location: jax.Array, scale: jax.Array) -> distrax.Normal:
    """A Gaussian with independent components."""
    return distrax.Normal(location, scale)


def bernoulli(probability: jax.Array) -> distrax.Bernoulli:
    """A coin whose samples are f32 zeros and ones."""
    return distrax.Bernoulli(probs=probability, dtype=jnp.float32)
