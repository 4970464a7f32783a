"""Bayesian quadrature for networks: scores are pytrees and meet only in their Gram matrix (Akella et al. 2021).

Neither the Fisher information nor anything else of n x n is built. Faults inside ``jit`` are flagged as in
`srl_jax.bayes.quadrature`: ``ok`` is False and the weights are zero.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular

from srl_jax.bayes.quadrature import NOISE, SHRINKAGE, dot, jittered_cholesky


class Posterior(NamedTuple):
    """The gradient's posterior; its mean is ``sum_i weights_i u_i``, see `combine`."""

    weights: jax.Array  # f[M]
    factor: jax.Array  # f[M, M] lower Cholesky factor of the kernel plus noise
    ridge: jax.Array  # f[] added to the diagonal of the Fisher information
    scale: jax.Array  # f[] prior variance of the Fisher kernel
    ok: jax.Array  # bool[] False: a fault, and the above means nothing


def matrix(scores: Any) -> jax.Array:
    """The inner products ``u_i' u_j`` f[N, N] of scores, a pytree whose leaves have a leading axis N."""
    flat = [leaf.reshape(len(leaf), -1) for leaf in jax.tree.leaves(scores)]
    return jnp.sum(jnp.stack([dot(leaf, leaf.T) for leaf in flat]), axis=0)


def posterior(
    gram: jax.Array,
    returns: jax.Array,
    state_kernel: jax.Array | None = None,
    *,
    noise: jax.Array | float = NOISE,
    scale: jax.Array | float = 1.0,
    ridge: jax.Array | float = SHRINKAGE,
    information: jax.Array | None = None,
) -> Posterior:
    """Model 2 of Bayesian quadrature with the kernel ``k_s + scale u_i' G^-1 u_j``: ``weights = scale C R``.

    A kernel of states alone adds nothing to the integral, since the score has mean zero in every state; it explains
    returns, as a baseline does (a constant kernel is a constant baseline). ``G = (U U' + r I) / N`` is of all N scores,
    of which the first M have returns, and Woodbury gives ``U' G^-1 U = N S (S + r I)^-1`` for the Gram matrix S.

    That G is the policy's only where the scores are those of its own actions. Where they are not, give `information`:
    the policy is then the one that moves along the scores alone, ``theta + U w``, and the Fisher kernel
    ``S (U' G U + r S)^-1 S``.

    Args:
        gram: f[N, N], see `matrix`. Scores beyond the first M cost no reward, only draws from the policy. With N = M
            and no state kernel the mean is Monte-Carlo's, shrunk (see `quadrature.model2`).
        returns: f[M], M <= N, of trajectories or, as advantages or by `gptd.state_kernel`, of single steps.
        state_kernel: f[M, M], positive semi-definite, with its own scale; None is zero.
        noise: f[] variance of a return about the process.
        scale: f[] prior variance of the Fisher kernel.
        ridge: f[] r as a fraction of the mean diagonal of S, or of G in the span of the scores.
        information: f[N, D] F with ``F F' = U' G U`` for the policy's own G (`variance` then has no meaning).

    Raises:
        ValueError: no return, or shapes that do not fit.
    """
    gram, returns, state_kernel = _checked(gram, returns, state_kernel)
    count, total = len(returns), len(gram)
    level = jnp.asarray(ridge * jnp.mean(jnp.diagonal(gram)), gram.dtype)
    half = (_fisher_half(gram, level) if information is None else _half_of(gram, information, ridge))[:count]
    kernel = state_kernel + scale * dot(half, half.T)
    factor, _ = jittered_cholesky(kernel, jnp.asarray(noise, kernel.dtype))
    weights = scale * cho_solve((factor, True), returns)
    ok = jnp.all(jnp.isfinite(weights)) & (level > 0.0) & (jnp.asarray(noise) >= 0.0)
    return Posterior(
        weights=jnp.where(ok, weights, 0.0),
        factor=jnp.where(ok, factor, jnp.eye(count, dtype=factor.dtype)),
        ridge=jnp.where(ok, level / total, 1.0),
        scale=jnp.asarray(scale, gram.dtype),
        ok=ok,
    )


def combine(weights: jax.Array, scores: Any) -> Any:
    """``sum_i weights_i u_i`` over the first M scores: f[M] and a pytree of f[N, ...] to a pytree of f[...]."""
    return jax.tree.map(lambda leaf: jnp.tensordot(weights, leaf[: len(weights)], axes=1, precision="highest"), scores)


def variance(posterior: Posterior, scores: Any) -> Any:
    """The diagonal of the covariance ``scale G - scale^2 U C U'``, in M^2 n operations.

    Args:
        posterior: from `posterior`.
        scores: pytree of f[N, ...], those of the Gram matrix.

    Returns:
        A pytree of f[...], at least zero.
    """
    count = len(posterior.weights)

    def of_leaf(leaf: jax.Array) -> jax.Array:
        flat = leaf.reshape(len(leaf), -1)
        prior = posterior.scale * (jnp.mean(flat**2, axis=0) + posterior.ridge)
        known = posterior.scale * solve_triangular(posterior.factor, flat[:count], lower=True)
        return jnp.maximum(prior - jnp.sum(known**2, axis=0), 0.0).reshape(leaf.shape[1:])

    return jax.tree.map(of_leaf, scores)


def _fisher_half(gram: jax.Array, level: jax.Array) -> jax.Array:
    # A with A A' = N S (S + r I)^-1. By Cholesky factors of S + r I the product was indefinite in f32.
    values, vectors = jnp.linalg.eigh(gram)
    values = jnp.maximum(values, 0.0)
    gain = jnp.sqrt(len(gram) * values / (values + level))
    return vectors * gain[None, :]


def _half_of(gram: jax.Array, information: jax.Array, ridge: jax.Array | float) -> jax.Array:
    # A with A A' = S (F F' + r S)^-1 S, by way of an orthonormal basis U b of the scores' span, where G is b' F F' b.
    values, vectors = jnp.linalg.eigh(gram)
    kept = values > len(gram) * jnp.finfo(gram.dtype).eps * values[-1]
    root = jnp.sqrt(jnp.where(kept, values, 1.0))
    basis = vectors * jnp.where(kept, 1.0 / root, 0.0)[None, :]
    within = dot(basis.T, jnp.asarray(information, gram.dtype))
    fisher = dot(within, within.T)
    level = ridge * jnp.trace(fisher) / jnp.maximum(jnp.sum(kept), 1)
    factor, _ = jittered_cholesky(fisher, level)
    return solve_triangular(factor, (vectors * jnp.where(kept, root, 0.0)[None, :]).T, lower=True).T


def _checked(
    gram: jax.Array, returns: jax.Array, state_kernel: jax.Array | None
) -> tuple[jax.Array, jax.Array, jax.Array]:
    shape = jnp.shape(returns)
    if len(shape) != 1 or 0 in shape:
        raise ValueError(f"returns has shape {shape}: give (M,) with M >= 1.")
    if jnp.ndim(gram) != 2 or gram.shape[0] != gram.shape[1] or len(gram) < shape[0]:
        raise ValueError(f"gram has shape {jnp.shape(gram)}: give (N, N) with N >= {shape[0]}, the number of returns.")
    if state_kernel is not None and jnp.shape(state_kernel) != shape * 2:
        raise ValueError(f"state_kernel has shape {jnp.shape(state_kernel)}: give {shape * 2} for {shape[0]} returns.")
    dtype = jnp.result_type(gram, returns, jnp.float32)
    kernel = jnp.zeros(shape * 2) if state_kernel is None else state_kernel
    return jnp.asarray(gram, dtype), jnp.asarray(returns, dtype), jnp.asarray(kernel, dtype)
