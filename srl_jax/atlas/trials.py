"""What policies are worth under a damage that none of the hypotheses is: a normal prior from the matrix, and trials.

Intelligent trial and error (Cully et al. 2015) with the atlas in place of a map of gaits: the worth of all I policies
under the present damage is one vector, normal with the mean and covariance of the matrix' columns under the belief. A
segment of walking by policy i observes its i-th component, and so says something of all that do as well or as badly as
i across damages. Old segments count less and less, since the damage may have changed.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve

dot = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


class Prior(NamedTuple):
    """Settings, as shares of the healthy speed."""

    own: float = 0.15  # standard deviation of a policy's worth that no other policy shares
    learned: float = 0.25  # the same of a policy that was learned after the damage
    strange: float = 1.0  # weight of the covariance over all damages where it is none of them
    flat: float = 8.0  # by which the belief among the known is tempered where it is none of them
    noise: float = 0.2  # standard deviation of what a segment shows about the worth
    memory: float = 20.0  # segments after which an observation's variance has doubled


PRIOR = Prior()


class Trials(NamedTuple):
    """The last K segments, the newest last; `count` of them mean something."""

    policy: jax.Array  # i32[K]
    worth: jax.Array  # f32[K] share of the healthy speed
    count: jax.Array  # i32[]


class Forecast(NamedTuple):
    """What a segment will be worth, as shares of the healthy speed: normal."""

    mean: jax.Array  # f32[]
    deviation: jax.Array  # f32[]


class Ended(NamedTuple):
    """The segment that has just ended; none has where its worth is NaN."""

    worth: jax.Array  # f32[] share of the healthy speed
    forecast: Forecast  # when it began
    disappointing: jax.Array  # bool[] whether it was worth far less than the policy is held to be


def none(room: int) -> Trials:
    """No segment yet, and room for so many."""
    return Trials(jnp.zeros(room, jnp.int32), jnp.zeros(room), jnp.zeros((), jnp.int32))


def record(trials: Trials, policy: jax.Array, worth: jax.Array) -> Trials:
    """With one more segment; the oldest is forgotten where there is no room."""
    room = len(trials.policy)
    return Trials(
        jnp.roll(trials.policy, -1).at[-1].set(policy),
        jnp.roll(trials.worth, -1).at[-1].set(worth),
        jnp.minimum(trials.count + 1, room),
    )


class Worth(NamedTuple):
    """The prior as a mean and the columns of a factor: ``cov = factor factor' + diag(own^2)``."""

    mean: jax.Array  # f32[I]
    factor: jax.Array  # f32[I, 2 D]
    own: jax.Array  # f32[I] standard deviation that no other policy shares


def expect(log_belief: jax.Array, matrix: jax.Array, prior: Prior = PRIOR, learned: int = 0) -> Worth:
    """What the belief f32[D + 1] says of every policy before any trial, from the matrix f32[I, D].

    Damages whose belief is -inf are left out of all. The last `learned` policies are less sure than the others.
    """
    known, strange = jnp.exp(jax.nn.log_softmax(log_belief[:-1])), jnp.exp(log_belief[-1])
    flat = jnp.exp(jax.nn.log_softmax(log_belief[:-1] / prior.flat))
    weight = (1.0 - strange) * known + strange * flat
    mean = dot(matrix, weight)
    likely = (matrix - mean[:, None]) * jnp.sqrt(weight)[None]
    even = jnp.isfinite(log_belief[:-1]) / jnp.sum(jnp.isfinite(log_belief[:-1]))
    anything = (matrix - dot(matrix, even)[:, None]) * jnp.sqrt(prior.strange * strange * even)[None]
    own = jnp.where(jnp.arange(len(mean)) < len(mean) - learned, prior.own, prior.learned)
    return Worth(mean, jnp.concatenate([likely, anything], axis=1), own)


def update(worth: Worth, trials: Trials, start: jax.Array, noise: jax.Array, prior: Prior = PRIOR) -> jax.Array:
    """The vector f32[I] that a start becomes once it is told of the trials (Matheron's rule).

    From the prior's mean without noise it is the posterior's mean; from a draw of the prior, with a draw of the
    observations' noise, a draw of the posterior.

    Args:
        worth: see `expect`.
        trials: segments.
        start: f32[I].
        noise: f32[K] standard normal, or zeros.
        prior: settings.
    """
    seen = _seen(worth, trials, prior)
    surprise = jnp.where(seen.valid, trials.worth - start[trials.policy] - seen.noise * noise, 0.0)
    told = jnp.where(seen.valid, cho_solve((jnp.linalg.cholesky(seen.covariance), True), surprise), 0.0)
    alone = jnp.zeros(len(start)).at[trials.policy].add(told)
    return start + dot(worth.factor, dot(seen.rows.T, told)) + jnp.square(worth.own) * alone


class _Seen(NamedTuple):
    """The K segments as observations."""

    valid: jax.Array  # bool[K]
    noise: jax.Array  # f32[K] standard deviation
    rows: jax.Array  # f32[K, 2 D] of the factor
    covariance: jax.Array  # f32[K, K] of what was observed, noise included


def _seen(worth: Worth, trials: Trials, prior: Prior) -> _Seen:
    room = len(trials.policy)
    age = jnp.arange(room - 1, -1, -1.0)
    valid = age < trials.count
    noise = prior.noise * jnp.sqrt(jnp.exp2(age / prior.memory))
    rows = worth.factor[trials.policy]
    same = trials.policy[:, None] == trials.policy[None]
    inner = dot(rows, rows.T) + jnp.square(worth.own)[trials.policy][:, None] * same
    inner = jnp.where(valid[:, None] & valid[None], inner, 0.0) + jnp.diag(jnp.where(valid, noise**2, 1.0))
    return _Seen(valid, noise, rows, inner)


def deviation(worth: Worth, trials: Trials, policy: jax.Array, prior: Prior = PRIOR) -> jax.Array:
    """Standard deviation f32[] of what the next segment of one policy will show, noise included."""
    seen, row, own = _seen(worth, trials, prior), worth.factor[policy], jnp.square(worth.own[policy])
    shared = jnp.where(seen.valid, dot(seen.rows, row) + own * (trials.policy == policy), 0.0)
    known = dot(shared, cho_solve((jnp.linalg.cholesky(seen.covariance), True), shared))
    return jnp.sqrt(jnp.maximum(dot(row, row) + own - known, 0.0) + prior.noise**2)


def mean(worth: Worth, trials: Trials, prior: Prior = PRIOR) -> jax.Array:
    """The posterior's mean f32[I]."""
    return update(worth, trials, worth.mean, jnp.zeros(len(trials.policy)), prior)


def draw(worth: Worth, trials: Trials, key: jax.Array, prior: Prior = PRIOR) -> jax.Array:
    """One draw f32[I] of the posterior."""
    factor_key, own_key, noise_key = jax.random.split(key, 3)
    shared = dot(worth.factor, jax.random.normal(factor_key, worth.factor.shape[1:]))
    start = worth.mean + shared + worth.own * jax.random.normal(own_key, worth.mean.shape)
    return update(worth, trials, start, jax.random.normal(noise_key, trials.policy.shape), prior)
