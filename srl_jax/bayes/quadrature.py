"""The policy gradient as an integral with a posterior: Bayesian quadrature, and plain Monte-Carlo beside it.

Each estimator takes the scores ``u_i = sum_t grad log pi(a_t | s_t)`` and returns R_i of M trajectories. Equations are
those of Ghavamzadeh & Engel (2006) and Ghavamzadeh, Engel & Valko (JMLR 2016). For networks, see `srl_jax.bayes.gram`.

A fault inside ``jit`` (non-finite input, singular Fisher information, negative noise) raises nothing: ``ok`` is then
False, the mean zero and the covariance the identity, so that a trainer can count it and go on.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular

NOISE = 1e-2  # variance of what a Gaussian process cannot explain, in units of its prior variance where `scale` is 1
SHRINKAGE = 1e-3
# Accelerators multiply f32 at 10 bits of mantissa unless told otherwise; a Cholesky factor of that is NaN.
dot = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


class Gradient(NamedTuple):
    """A Gaussian belief about the gradient."""

    mean: jax.Array  # f[n]
    covariance: jax.Array  # f[n, n]
    ok: jax.Array  # bool[] False: a fault, and the two above mean nothing


def monte_carlo(
    scores: jax.Array,
    returns: jax.Array,
    fisher: jax.Array | None = None,
    *,
    noise: jax.Array | float = NOISE,
    scale: jax.Array | float = 1.0,
) -> Gradient:
    """The likelihood-ratio estimate ``sum_i R_i u_i / M``, with the sampling covariance of that mean.

    Args:
        scores: f[M, n].
        returns: f[M].
        fisher: unused, as are `noise` and `scale`: all estimators have one signature.

    Raises:
        ValueError: see `model1`.
    """
    scores, returns = _checked(scores, returns, fisher)
    count = len(returns)
    samples = scores * returns[:, None]
    mean = jnp.mean(samples, axis=0)
    # One trajectory has no spread: its second moment stands in.
    centred = samples - mean[None] if count > 1 else samples
    return guard(mean, dot(centred.T, centred) / (count * max(count - 1, 1)), jnp.array(True))


def model1(
    scores: jax.Array,
    returns: jax.Array,
    fisher: jax.Array | None = None,
    *,
    noise: jax.Array | float = NOISE,
    scale: jax.Array | float = 1.0,
) -> Gradient:
    """Bayesian quadrature, model 1: a Gaussian process on ``R(xi) u(xi)`` with kernel ``(1 + u' G^-1 u')^2``.

    Mean ``Y C b`` and covariance ``(1 + n - b' C b) I``, with ``Y = [R_i u_i]``, ``b_i = 1 + u_i' G^-1 u_i`` and
    ``C = (K + noise I)^-1`` (JMLR 2016). The covariance does not depend on the returns. The kernel has
    ``p = (n + 1)(n + 2) / 2`` features: below M = p the M x M system is solved, from there on the p x p one.

    Args:
        scores: f[M, n]; computed in f64 if this or `returns` is f64, else in f32.
        returns: f[M].
        fisher: f[n, n] Fisher information ``G = E[u u']``; None estimates it from `scores`, see `estimate_fisher`.
        noise: f[] variance of an observation, in the units of ``(R u)^2``.
        scale: f[] factor of the kernel; the mean depends on ``noise / scale`` only.

    Raises:
        ValueError: no trajectory, no parameter, or shapes that do not fit.
    """
    scores, returns = _checked(scores, returns, fisher)
    white, _, ok = whiten(scores, fisher)
    count, size = scores.shape
    ratio, valid = _ratio(noise, scale, scores.dtype)
    if (size + 1) * (size + 2) // 2 <= count:
        features, expected = _quadratic(white)
        factor, shift = jittered_cholesky(dot(features.T, features), ratio)
        solution = cho_solve((factor, True), expected)
        weights, variance = dot(features, solution), shift * dot(expected, solution)
    else:
        b = 1.0 + jnp.sum(white**2, axis=1)
        factor, _ = jittered_cholesky((1.0 + dot(white, white.T)) ** 2, ratio)
        weights = cho_solve((factor, True), b)
        variance = jnp.maximum(1.0 + size - dot(b, weights), 0.0)
    mean = dot(weights * returns, scores)
    return guard(mean, scale * variance * jnp.eye(size, dtype=scores.dtype), ok & valid)


def model2(
    scores: jax.Array,
    returns: jax.Array,
    fisher: jax.Array | None = None,
    *,
    noise: jax.Array | float = NOISE,
    scale: jax.Array | float = 1.0,
) -> Gradient:
    """Bayesian quadrature, model 2: a Gaussian process on ``R(xi)`` with the Fisher kernel ``u' G^-1 u'``.

    Mean ``U C R`` and covariance ``G - U C U'``, with ``U = [u_i]`` and ``C = (K + noise I)^-1`` (JMLR 2016). The
    process is ``R = w' u`` with ``w ~ N(0, G^-1)`` and the gradient ``G w``, so an n x n system is solved whatever M.

    With the *empirical* ``G = U U' / M`` of the same data the mean is Monte-Carlo's times ``M / (M + noise / scale)``:
    nothing is gained. Estimate G from other scores (they cost no reward), or take `gram.posterior` with a state kernel.

    Args and errors are those of `model1`, but `noise` is in the units of ``R^2``.
    """
    scores, returns = _checked(scores, returns, fisher)
    white, root, ok = whiten(scores, fisher)
    ratio, valid = _ratio(noise, scale, scores.dtype)
    factor, shift = jittered_cholesky(dot(white.T, white), ratio)
    mean = dot(root, cho_solve((factor, True), dot(returns, white)))
    half = solve_triangular(factor, root.T, lower=True)
    return guard(mean, scale * shift * dot(half.T, half), ok & valid)


def natural(gradient: Gradient, fisher: jax.Array) -> Gradient:
    """The natural gradient: mean ``G^-1 m`` and covariance ``G^-1 S G^-1``, for G f[n, n].

    Raises:
        ValueError: `fisher` is not n x n.
    """
    _require_fisher(fisher, len(gradient.mean))
    root, ok = _fisher_root(jnp.asarray(fisher, gradient.mean.dtype))
    once = cho_solve((root, True), gradient.covariance)
    return guard(cho_solve((root, True), gradient.mean), cho_solve((root, True), once.T), ok & gradient.ok)


def estimate_fisher(scores: jax.Array, shrinkage: jax.Array | float = SHRINKAGE) -> jax.Array:
    """The Fisher information ``U U' / M``, moved towards the identity by `shrinkage`.

    ``(1 - s) S + s (tr S / n) I`` keeps the trace and has full rank for s > 0, even with fewer scores than parameters.

    Args:
        scores: f[M, n].
        shrinkage: f[] s in [0, 1].

    Returns:
        f[n, n].

    Raises:
        ValueError: no score, or `scores` is not of rank 2.
    """
    _require_scores(scores)
    count, size = scores.shape
    empirical = dot(scores.T, scores) / count
    return (1.0 - shrinkage) * empirical + shrinkage * jnp.trace(empirical) / size * jnp.eye(size, dtype=scores.dtype)


def jittered_cholesky(matrix: jax.Array, noise: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The lower Cholesky factor of ``A + s I`` and s, the noise plus a jitter.

    The jitter is ``p eps`` times the mean diagonal of A f[p, p], the order of the factorisation's own rounding error:
    at p = 1,000 1e-4 of that diagonal in f32, 2e-13 in f64.
    """
    shift = noise + jnp.finfo(matrix.dtype).eps * jnp.trace(matrix)
    return jnp.linalg.cholesky(matrix + shift * jnp.eye(len(matrix), dtype=matrix.dtype)), shift


def whiten(scores: jax.Array, fisher: jax.Array | None) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Scores f[M, n] as ``L^-1 u`` for ``G = L L'``, the root L f[n, n], and whether G was regular."""
    fisher = estimate_fisher(scores) if fisher is None else jnp.asarray(fisher, scores.dtype)
    root, ok = _fisher_root(fisher)
    return solve_triangular(root, scores.T, lower=True).T, root, ok


def _fisher_root(fisher: jax.Array) -> tuple[jax.Array, jax.Array]:
    # A pivot within rounding of zero is a singular matrix, in whatever units the parameter has. Never jittered: a
    # direction without information would otherwise look like one whose gradient is known.
    root = jnp.linalg.cholesky(fisher)
    rounding = len(fisher) * jnp.finfo(fisher.dtype).eps
    regular = jnp.all(jnp.diagonal(root) ** 2 > rounding * jnp.diagonal(fisher))
    return jnp.where(regular, root, jnp.eye(len(fisher), dtype=fisher.dtype)), regular


def _quadratic(white: jax.Array) -> tuple[jax.Array, jax.Array]:
    # Features f[M, p] of (1 + v'w)^2 and their expectation f[p] where v has mean 0 and covariance I.
    count, size = white.shape
    rows, columns = jnp.triu_indices(size, 1)
    linear, cross = white, white[:, rows] * white[:, columns]
    features = [jnp.ones((count, 1), white.dtype), white**2, 2**0.5 * linear, 2**0.5 * cross]
    known = jnp.zeros(sum(part.shape[1] for part in features), white.dtype)
    return jnp.concatenate(features, axis=1), known.at[: size + 1].set(1.0)


def guard(mean: jax.Array, covariance: jax.Array, ok: jax.Array) -> Gradient:
    """A gradient f[n] with covariance f[n, n]; zero and the identity where they are not finite or `ok` is False."""
    ok = ok & jnp.all(jnp.isfinite(mean)) & jnp.all(jnp.isfinite(covariance))
    identity = jnp.eye(len(mean), dtype=covariance.dtype)
    return Gradient(jnp.where(ok, mean, 0.0), jnp.where(ok, covariance, identity), ok)


def _ratio(noise: jax.Array | float, scale: jax.Array | float, dtype: jnp.dtype) -> tuple[jax.Array, jax.Array]:
    noise, scale = jnp.asarray(noise, dtype), jnp.asarray(scale, dtype)
    return noise / scale, (noise >= 0.0) & (scale > 0.0)


def _require_scores(scores: jax.Array) -> None:
    if jnp.ndim(scores) != 2 or 0 in jnp.shape(scores):
        raise ValueError(
            f"scores has shape {jnp.shape(scores)}: give (M, n), M >= 1 trajectories of n >= 1 parameters."
        )


def _require_fisher(fisher: jax.Array, size: int) -> None:
    if jnp.shape(fisher) != (size, size):
        raise ValueError(f"fisher has shape {jnp.shape(fisher)}: give ({size}, {size}), a row per parameter.")


def _checked(scores: jax.Array, returns: jax.Array, fisher: jax.Array | None) -> tuple[jax.Array, jax.Array]:
    _require_scores(scores)
    count, size = jnp.shape(scores)
    if jnp.shape(returns) != (count,):
        raise ValueError(f"returns has shape {jnp.shape(returns)}: give ({count},), one return per row of scores.")
    if fisher is not None:
        _require_fisher(fisher, size)
    dtype = jnp.result_type(scores, returns, jnp.float32)
    return jnp.asarray(scores, dtype), jnp.asarray(returns, dtype)
