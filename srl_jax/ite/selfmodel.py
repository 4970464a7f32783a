"""Self-modelling: which damage explains what the robot feels, and which motion would tell best (Bongard et al. 2006).

Bongard, Zykov & Lipson (Science 2006), with a catalogue of D damages in place of evolved models. Hypothesis d predicts
a trace of F senses over T steps under each of P probing motions. The robot makes the motion about which the hypotheses
that are still likely disagree most, and every hypothesis loses belief by the error of its prediction. Knows no
simulator.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp

CHOICES = ("disagreement", "random")
# Errors of a trace are much alike from one step to the next (a robot that starts askew stays askew), so its T steps are
# not T witnesses. Counting half a second of them, 10 steps, as one leaves the ranking after a probe as it is.
CORRELATION = 10.0  # steps


class Identification(NamedTuple):
    """What n probes told."""

    probe: jax.Array  # i32[n] the motions made, none twice
    log_posterior: jax.Array  # f32[n, D] normalised, after each of them


def residual_scales(predicted: jax.Array, repeated: jax.Array, sensor_noise: jax.Array) -> jax.Array:
    """The standard deviation of each sense about a *true* hypothesis: f32[F].

    The root of the mean squared difference of two simulations of the same damages under the same motions, from two
    starts, plus the sensors' variance. It makes senses comparable (rad, rad/s, unit vectors) and needs no damaged
    robot. A trace that is not finite is left out.

    Args:
        predicted: f32[..., T, F] traces that hypotheses predict.
        repeated: f32[..., T, F] the same from starts like the robot's.
        sensor_noise: f32[F] standard deviations.

    Raises:
        ValueError: shapes that do not fit.
    """
    if predicted.shape != repeated.shape or sensor_noise.shape != predicted.shape[-1:]:
        shapes = f"predicted {predicted.shape}, repeated {repeated.shape} and sensor_noise {sensor_noise.shape}"
        raise ValueError(f"{shapes} do not fit; [..., T, F] twice and [F] are needed.")
    squares = ((predicted - repeated) ** 2).reshape(-1, predicted.shape[-1])
    finite = jnp.isfinite(squares)
    mean = jnp.sum(jnp.where(finite, squares, 0.0), axis=0) / jnp.maximum(jnp.sum(finite, axis=0), 1)
    return jnp.sqrt(mean + sensor_noise**2)


def log_likelihood(
    observed: jax.Array, predicted: jax.Array, scales: jax.Array, correlation: jax.Array | float = CORRELATION
) -> jax.Array:
    """``-||o - o_d||^2 / 2 sigma^2`` of one probe, without the constant: f32[D].

    A hypothesis whose prediction is not finite has -inf; if none is finite the probe told nothing, and all have 0.

    Args:
        observed: f32[T, F] what the robot felt.
        predicted: f32[D, T, F].
        scales: f32[F] sigma of each sense, see `residual_scales`.
        correlation: f32[] steps whose errors count as one.
    """
    errors = (predicted - observed[None]) / scales[None, None]
    value = -0.5 / correlation * jnp.sum(errors**2, axis=(1, 2))
    finite = jnp.isfinite(value)
    return jnp.where(finite, value, jnp.where(jnp.any(finite), -jnp.inf, 0.0))


def update(log_posterior: jax.Array, log_likelihoods: jax.Array) -> jax.Array:
    """Bayes' rule in logarithms, normalised: f32[D] and f32[D] -> f32[D].

    If what was left has become impossible altogether, belief stays as it was.
    """
    total = log_posterior + log_likelihoods
    evidence = logsumexp(total)
    return jnp.where(jnp.isfinite(evidence), total - evidence, log_posterior)


def distances(predicted: jax.Array, scales: jax.Array) -> jax.Array:
    """Half the squared distance, in sigmas, of any two hypotheses' traces under each probe: f32[P, D, D].

    ``w' distances_p w`` is the variance of the prediction over belief w, summed over steps and senses. In this form a
    choice costs P D^2 whatever the length of a trace, and nothing cancels when belief is nearly certain. A prediction
    that is not finite is at distance 0: it is no reason to make a motion.

    Args:
        predicted: f32[D, P, T, F].
        scales: f32[F].
    """
    scaled = jnp.moveaxis(predicted / scales[None, None, None], 0, 1)  # [P, D, T, F]
    scaled = scaled.reshape(*scaled.shape[:2], -1)

    def from_one(rows: jax.Array, row: jax.Array) -> jax.Array:
        return 0.5 * jnp.sum((rows - row[None]) ** 2, axis=-1)

    # One row at a time: all differences at once would be D times the memory of the predictions.
    result = jax.lax.map(lambda rows: jax.lax.map(lambda row: from_one(rows, row), rows), scaled)
    return jnp.where(jnp.isfinite(result), result, 0.0)


def disagreement(log_posterior: jax.Array, distances: jax.Array) -> jax.Array:
    """The variance of each probe's predicted trace over the posterior, in sigmas squared: f32[P]."""
    belief = jnp.exp(log_posterior)
    return jnp.einsum("d,pde,e->p", belief, distances, belief, precision="highest")


def next_probe(log_posterior: jax.Array, distances: jax.Array, used: jax.Array) -> jax.Array:
    """The probe i32[] of greatest disagreement among those not yet used.

    Args:
        log_posterior: f32[D], normalised.
        distances: f32[P, D, D], see `distances`.
        used: bool[P].
    """
    return _first_unused(disagreement(log_posterior, distances), used)


def identify(
    predicted: jax.Array,
    observed: jax.Array,
    scales: jax.Array,
    key: jax.Array,
    *,
    probes: int,
    choice: str = "disagreement",
    log_prior: jax.Array | None = None,
    pairs: jax.Array | None = None,
    correlation: jax.Array | float = CORRELATION,
) -> Identification:
    """Makes `probes` motions one after the other and returns the posterior after each.

    Args:
        predicted: f32[D, P, T, F] traces under each hypothesis.
        observed: f32[P, T, F] what the robot would feel in each motion; only those of chosen motions are looked at.
        scales: f32[F], see `residual_scales`.
        key: random key; used by ``random`` alone.
        probes: n, at most P.
        choice: ``disagreement`` or, as the baseline, ``random`` (without repetition).
        log_prior: f32[D]; None is uniform. It need not be normalised.
        pairs: f32[P, D, D], `distances` of `predicted`, where the caller has them: they are the same for all robots.
        correlation: see `log_likelihood`.

    Raises:
        ValueError: unknown `choice`, `probes` outside 1 to P, no hypothesis, or shapes that do not fit.
    """
    _check(predicted, observed, scales, probes, choice, log_prior)
    count = predicted.shape[0]
    if choice == "disagreement":
        pairs = distances(predicted, scales) if pairs is None else pairs

    def advance(carry: tuple[jax.Array, jax.Array], key: jax.Array):
        belief, used = carry
        if choice == "disagreement":
            probe = next_probe(belief, pairs, used)  # pyright: ignore[reportArgumentType]
        else:
            probe = _first_unused(jax.random.uniform(key, used.shape), used)
        belief = update(belief, log_likelihood(observed[probe], predicted[:, probe], scales, correlation))
        return (belief, used.at[probe].set(True)), Identification(probe, belief)

    prior = jnp.zeros(count) if log_prior is None else log_prior
    start = (prior - logsumexp(prior), jnp.zeros(len(observed), bool))
    return jax.lax.scan(advance, start, jax.random.split(key, probes))[1]


def top(log_posterior: jax.Array, truth: jax.Array, k: int) -> jax.Array:
    """The chance in [0, 1] that the true damage is among the k most likely, ties broken by lot: f32[].

    Args:
        log_posterior: f32[D].
        truth: i32[] index of the true damage.
        k: length of the list.
    """
    own = log_posterior[truth]
    above, equal = jnp.sum(log_posterior > own), jnp.sum(log_posterior == own)
    return jnp.clip((k - above) / jnp.maximum(equal, 1), 0.0, 1.0)


def _first_unused(score: jax.Array, used: jax.Array) -> jax.Array:
    return jnp.argmax(jnp.where(used, -jnp.inf, score)).astype(jnp.int32)


def _check(
    predicted: jax.Array,
    observed: jax.Array,
    scales: jax.Array,
    probes: int,
    choice: str,
    log_prior: jax.Array | None,
) -> None:
    """Raises ValueError for what `identify` does not accept."""
    if choice not in CHOICES:
        raise ValueError(f"choice is {choice!r}: choose one of {', '.join(CHOICES)}.")
    shape = predicted.shape
    if len(shape) != 4 or 0 in shape:
        raise ValueError(f"predicted has shape {shape}; [D, P, T, F] is needed, none of them 0.")
    prior = shape[:1] if log_prior is None else log_prior.shape
    if observed.shape != shape[1:] or scales.shape != shape[3:] or prior != shape[:1]:
        others = f"observed {observed.shape}, scales {scales.shape} and log_prior {prior}"
        raise ValueError(f"{others} do not fit predicted {shape}; [P, T, F], [F] and [D] are needed.")
    if not 1 <= probes <= shape[1]:
        raise ValueError(f"probes is {probes}; accepted are 1 to {shape[1]}, the motions there are.")
