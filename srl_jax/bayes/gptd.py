"""A Gaussian process for Q from temporal differences, and the policy gradient's posterior that follows from it.

Engel, Mannor & Meir (2005) for the critic, Ghavamzadeh & Engel (2007) for the actor: ``r = H Q + N`` with a row
(1, -gamma) of H per transition. Transitions are pairs (x, x'), so H stays implicit, and a sample of a replay serves as
well as a trajectory:

- an episode that terminates has discount 0 there, its row is (1);
- one that is cut short keeps discount 1 and its true next observation: that point has no equation of its own;
- T transitions cost one T x T Cholesky factorisation.

Faults inside ``jit`` are flagged as in `srl_jax.bayes.quadrature`.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular

from srl_jax.bayes import quadrature
from srl_jax.bayes.quadrature import NOISE, Gradient, dot

Kernel = Callable[[jax.Array, jax.Array], jax.Array]  # states f[P, F], f[Q, F] -> f[P, Q]


class Transitions(NamedTuple):
    """T transitions in any order; ``next_scores`` of zero bootstrap from V(s'), the mean of Q(s', a') over a'."""

    features: jax.Array  # f[T, F] states, as the state kernel sees them
    scores: jax.Array  # f[T, n] grad log pi(a | s)
    rewards: jax.Array  # f[T]
    discounts: jax.Array  # f[T] gamma, or 0 where the episode terminated
    next_features: jax.Array  # f[T, F]
    next_scores: jax.Array  # f[T, n]


class Critic(NamedTuple):
    """The posterior of Q given transitions; `q` and `gradient` read it."""

    data: Transitions
    weights: jax.Array  # f[T] (H K H' + Sigma)^-1 r; alpha is this at x and -discount times it at x'
    factor: jax.Array  # f[T, T] lower Cholesky factor of H K H' + Sigma
    root: jax.Array  # f[n, n] lower Cholesky factor of the Fisher information G
    scale: jax.Array  # f[] prior variance of the Fisher kernel
    ok: jax.Array  # bool[] False: a fault, and weights are zero


def rbf(length: jax.Array | float, scale: jax.Array | float = 1.0) -> Kernel:
    """The state kernel ``scale exp(-|s - s'|^2 / (2 length^2))``; length f[] or f[F]."""

    def kernel(x: jax.Array, y: jax.Array) -> jax.Array:
        x, y = x / jnp.broadcast_to(length, x.shape), y / jnp.broadcast_to(length, y.shape)
        square = jnp.sum(x**2, axis=1)[:, None] + jnp.sum(y**2, axis=1)[None, :] - 2.0 * dot(x, y.T)
        return scale * jnp.exp(-0.5 * jnp.maximum(square, 0.0))

    return kernel


def state_kernel(kernel: Kernel, features: jax.Array, next_features: jax.Array, discounts: jax.Array) -> jax.Array:
    """The prior covariance f[T, T] of ``V(s) - discount V(s')``.

    Given to `gram.posterior` beside rewards and the scores of steps, it makes Bayesian actor-critic for networks.
    """
    cross = discounts[None, :] * kernel(features, next_features)
    after = discounts[:, None] * discounts[None, :] * kernel(next_features, next_features)
    return kernel(features, features) - cross - cross.T + after


def fit(
    data: Transitions,
    kernel: Kernel,
    fisher: jax.Array | None = None,
    *,
    noise: jax.Array | float = NOISE,
    scale: jax.Array | float = 1.0,
    linked: jax.Array | None = None,
) -> Critic:
    """The posterior of Q under the prior covariance ``k_s(s, s') + scale u' G^-1 u'``.

    ``alpha = H' (H K H' + Sigma)^-1 r`` and ``C = H' (H K H' + Sigma)^-1 H`` (Ghavamzadeh & Engel 2007).

    Args:
        data: T transitions.
        kernel: of states, such as ``rbf(1.0)``.
        fisher: f[n, n] Fisher information of single steps; None estimates it from ``data.scores``.
        noise: f[] variance sigma^2, in the units of the reward squared.
        scale: f[] prior variance of the Fisher kernel.
        linked: None for independent noise, ``Sigma = sigma^2 I``, for near-deterministic dynamics, rows in any order.
            bool[T] for Engel's correlated noise, ``Sigma = sigma^2 H H'``, which is regression on Monte-Carlo returns:
            true where the next row starts at the very point in which this row ends.

    Raises:
        ValueError: no transition, or shapes that do not fit.
    """
    data = _checked(data, linked)
    size = data.scores.shape[1]
    if fisher is not None and jnp.shape(fisher) != (size, size):
        raise ValueError(f"fisher has shape {jnp.shape(fisher)}: give ({size}, {size}), a row per parameter.")
    _, root, regular = quadrature.whiten(data.scores, fisher)
    white = solve_triangular(root, _differences(data).T, lower=True).T
    covariance = state_kernel(kernel, data.features, data.next_features, data.discounts) + scale * dot(white, white.T)
    level = jnp.asarray(noise, covariance.dtype)
    if linked is None:
        factor, _ = quadrature.jittered_cholesky(covariance, level)
    else:
        covariance += level * _chained(data.discounts, linked)
        factor, _ = quadrature.jittered_cholesky(covariance, jnp.zeros_like(level))
    weights = cho_solve((factor, True), data.rewards)
    ok = regular & jnp.all(jnp.isfinite(weights)) & (level >= 0.0)
    return Critic(
        data=data,
        weights=jnp.where(ok, weights, 0.0),
        factor=jnp.where(ok, factor, jnp.eye(len(factor), dtype=factor.dtype)),
        root=root,
        scale=jnp.asarray(scale, weights.dtype),
        ok=ok,
    )


def q(critic: Critic, kernel: Kernel, features: jax.Array, scores: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Posterior mean f[P] and variance f[P] of Q at features f[P, F] and scores f[P, n]; scores of zero give V."""
    data = critic.data
    white = solve_triangular(critic.root, scores.T, lower=True)
    along = solve_triangular(critic.root, _differences(data).T, lower=True)
    states = kernel(features, data.features) - data.discounts[None, :] * kernel(features, data.next_features)
    cross = states + critic.scale * dot(white.T, along)
    prior = jax.vmap(lambda f: kernel(f[None], f[None])[0, 0])(features) + critic.scale * jnp.sum(white**2, axis=0)
    known = solve_triangular(critic.factor, cross.T, lower=True)
    return dot(cross, critic.weights), jnp.maximum(prior - jnp.sum(known**2, axis=0), 0.0)


def gradient(critic: Critic) -> Gradient:
    """The posterior of ``E[u Q]``: mean ``U alpha`` and covariance ``G - U C U'`` (Ghavamzadeh & Engel 2007).

    The expectation is over the states and actions whose Fisher information G is; the gradient of a whole episode is
    this times its number of steps. `scale` multiplies the mean and G once and ``U C U'`` twice.
    """
    differences = _differences(critic.data)
    mean = critic.scale * dot(critic.weights, differences)
    known = critic.scale * solve_triangular(critic.factor, differences, lower=True)
    covariance = critic.scale * dot(critic.root, critic.root.T) - dot(known.T, known)
    return quadrature.guard(mean, covariance, critic.ok)


def _differences(data: Transitions) -> jax.Array:
    # (H U')' row by row: f[T, n].
    return data.scores - data.discounts[:, None] * data.next_scores


def _chained(discounts: jax.Array, linked: jax.Array) -> jax.Array:
    # H H' f[T, T]: rows share a point only with their neighbours along a trajectory.
    beside = -discounts[:-1] * linked[:-1].astype(discounts.dtype)
    return jnp.diag(1.0 + discounts**2) + jnp.diag(beside, 1) + jnp.diag(beside, -1)


def _checked(data: Transitions, linked: jax.Array | None) -> Transitions:
    rows = jnp.shape(data.rewards)
    if len(rows) != 1 or 0 in rows:
        raise ValueError(f"rewards has shape {rows}: give (T,) with T >= 1.")
    for name, like in (("features", data.features), ("scores", data.scores)):
        if jnp.ndim(like) != 2 or jnp.shape(like)[0] != rows[0] or 0 in jnp.shape(like):
            raise ValueError(f"{name} has shape {jnp.shape(like)}: give ({rows[0]}, columns), one row per reward.")
    expected = {"discounts": rows, "next_features": data.features.shape, "next_scores": data.scores.shape}
    for name, shape in expected.items():
        if jnp.shape(getattr(data, name)) != shape:
            raise ValueError(f"{name} has shape {jnp.shape(getattr(data, name))}: give {shape}, as the other fields.")
    if linked is not None and jnp.shape(linked) != rows:
        raise ValueError(f"linked has shape {jnp.shape(linked)}: give {rows}, one flag per reward.")
    dtype = jnp.result_type(*data, jnp.float32)
    return Transitions(*(jnp.asarray(field, dtype) for field in data))
