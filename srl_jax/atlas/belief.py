"""The posterior over damages of a robot that just walks on: a hidden Markov model over who explains what is felt.

Every control step brings a residual of each hypothesis (`tracking`). Its likelihood is normal with a covariance that
was fitted under changed dynamics, so that other floors and masses are no evidence; it is tempered, since errors of
neighbouring steps are much alike. Damage may strike at any step with a small chance (the hazard), which makes the same
recursion the detector of a change. Beside the hypotheses stands 'none of these', which predicts as the best of them
does, but several times as vaguely.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp

from srl_jax.env.senses import SIZE

HEALTHY = 0.99  # share of the belief of the healthy robot before anything is felt


class Likelihood(NamedTuple):
    """How residuals tell hypotheses apart; the file of an atlas holds what was fitted."""

    whitening: jax.Array  # f32[24, 24] L with L C L' = 1, C the covariance of a true hypothesis' residuals
    tempering: float = 6.7  # steps whose errors count as one
    vague: float = 2.0  # times the standard deviation with which 'none of these' predicts
    most: float = 60.0  # squared norm beyond which a residual says no more: one bad reading must not decide
    mistaken: float = 0.05  # chance that a servo which is there does not answer, or one that is gone does
    hazard: float = 0.002  # chance a step that the damage changes


class Belief(NamedTuple):
    """Log-probabilities f32[D + 1], normalised; the last is of 'none of these'."""

    log: jax.Array


def even(admitted: jax.Array) -> jax.Array:
    """Log-probabilities f32[D + 1], the same for every admitted bool[D] hypothesis and for 'none of these'."""
    among = jnp.append(admitted, True)
    return jnp.where(among, -jnp.log(jnp.sum(among)), -jnp.inf)


def prior(log_even: jax.Array, healthy: float = HEALTHY) -> Belief:
    """At the start: the first hypothesis is that of the healthy robot, which has this share; the rest has `even`'s."""
    return Belief(
        jnp.logaddexp(jnp.log1p(-healthy) + log_even, jnp.full_like(log_even, -jnp.inf).at[0].set(jnp.log(healthy)))
    )


def strange(log_even: jax.Array, sure: float = 0.999) -> Belief:
    """It is none of these with this probability, and any of them alike."""
    share = jnp.log1p(-sure) + log_even
    return Belief(share.at[-1].set(jnp.logaddexp(share[-1], jnp.log(sure))))


def log_likelihood(errors: jax.Array, unexpected: jax.Array, admitted: jax.Array, likelihood: Likelihood) -> jax.Array:
    """Of D hypotheses and 'none of these', up to a constant: f32[D + 1].

    Args:
        errors: f32[D, 24] residuals.
        unexpected: i32[D] servos whose silence or answer a hypothesis did not expect.
        admitted: bool[D] hypotheses; none of the others lends its prediction to 'none of these'.
        likelihood: as fitted.
    """
    white = errors @ likelihood.whitening.T
    squares = jnp.minimum(jnp.sum(jnp.square(white), axis=1), likelihood.most)
    odds = jnp.log(likelihood.mistaken) - jnp.log1p(-likelihood.mistaken)
    vaguely = -0.5 * squares / likelihood.vague**2 - SIZE * jnp.log(likelihood.vague)
    # Packets are lost one by one, so silence is not tempered; 'none of these' takes any pattern of it for one mistake.
    own = -0.5 * squares / likelihood.tempering + odds * unexpected
    none = vaguely / likelihood.tempering + odds * jnp.minimum(unexpected, 1)
    return jnp.append(own, jnp.max(jnp.where(admitted, none, -jnp.inf)))


def update(belief: Belief, log_likelihoods: jax.Array, log_even: jax.Array, hazard: jax.Array | float) -> Belief:
    """One step: the damage may have changed to any other that `even` admits, then Bayes' rule."""
    total = jnp.logaddexp(jnp.log1p(-hazard) + belief.log, jnp.log(hazard) + log_even) + log_likelihoods
    return Belief(total - logsumexp(total))
