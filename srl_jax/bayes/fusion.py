"""Two uncertain gradients made one: the product of Gaussians with diagonal covariances, leaf by leaf."""

from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp

Tree = Any  # a pytree of float arrays, such as a gradient


class Gaussian(NamedTuple):
    """A diagonal Gaussian over a pytree."""

    mean: Tree
    variance: Tree  # the shapes of the mean, each entry >= 0; 0 is certain, inf knows nothing


def moments(draws: Tree) -> Gaussian:
    """Mean and unbiased variance of posterior draws of a gradient.

    Args:
        draws: pytree whose leaves are f32[M, ...]. Several masks of one member are not independent draws of an
            ensemble: the variance is then no better known than the number of members allows.

    Raises:
        ValueError: a leaf has fewer than two draws, of which there is no variance.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(draws):
        if leaf.ndim < 1 or leaf.shape[0] < 2:
            name = jax.tree_util.keystr(path) or "the array"
            raise ValueError(
                f"draws: {name} has shape {leaf.shape}; a variance needs a leading axis of 2 draws or more."
            )
    mean = jax.tree.map(lambda x: jnp.mean(x, axis=0), draws)
    return Gaussian(mean, jax.tree.map(lambda x: jnp.var(x, axis=0, ddof=1), draws))


def fuse(first: Gaussian, second: Gaussian) -> Gaussian:
    """Precision-weighted mean ``(m1 / v1 + m2 / v2) / (1 / v1 + 1 / v2)`` and variance ``1 / (1 / v1 + 1 / v2)``.

    The normalised product of the two densities. No precision is formed, so every limit is safe: a variance of 0 wins,
    an infinite one is ignored together with its mean, and equal ones (both 0 and both infinite included) give the
    average. A NaN stays NaN.

    Args:
        first: the actor's gradient and its posterior variance.
        second: pi_B's healthy gradient and its variance, of the same structure and shapes.

    Raises:
        AssertionError: structures or shapes differ.
    """
    chex.assert_trees_all_equal_shapes(first.mean, first.variance, second.mean, second.variance)
    fused = jax.tree.map(_fuse, *first, *second)
    outer, inner = jax.tree.structure(first.mean), jax.tree.structure((0, 0))
    return Gaussian(*jax.tree.transpose(outer, inner, fused))


def _fuse(m1: jax.Array, v1: jax.Array, m2: jax.Array, v2: jax.Array) -> tuple[jax.Array, jax.Array]:
    larger = jnp.maximum(v1, v2)
    scaled1, scaled2 = _over(v1, larger), _over(v2, larger)  # at most 1, so that their sum cannot overflow
    total = scaled1 + scaled2
    share1, share2 = scaled2 / total, scaled1 / total
    ignored1, ignored2 = share1 == 0.0, share2 == 0.0  # where a mean is not finite, 0 * mean is not 0
    mean = jnp.where(ignored1, 0.0, share1 * m1) + jnp.where(ignored2, 0.0, share2 * m2)
    return mean, jnp.minimum(v1, v2) / total


def _over(variance: jax.Array, larger: jax.Array) -> jax.Array:
    return jnp.where(variance == larger, 1.0, jnp.where(jnp.isinf(larger), 0.0, variance / larger))
