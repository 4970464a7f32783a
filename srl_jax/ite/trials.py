"""Map-based Bayesian optimisation, step by step: what a trial of one gait says of all gaits, and which to try next.

Cully, Clune, Tarapore & Mouret (Nature 2015): a Gaussian process over the gaits' descriptors whose prior mean is the
map, made before the damage. Everything here is of one robot; `vmap` over damages, seeds or maps gives one program for
all of them.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular

BONUSES = ("deviation", "variance")
# Accelerators multiply f32 at 10 bits of mantissa unless told otherwise.
dot = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


class GaitMap(NamedTuple):
    """What the healthy robot can do; a fitness of -inf marks an empty cell, which is never suggested."""

    descriptors: jax.Array  # f32[N, C] duty factor of each foot, in [0, 1]; finite in empty cells too
    fitness: jax.Array  # f32[N] m/s or m; trials are measured in the same unit


class ProcessSettings(NamedTuple):
    """Of process, bonus and stop, as published; variances are in the squared unit of the fitness, whatever that is."""

    length: jax.Array | float = 0.4  # rho, in descriptor space
    variance: jax.Array | float = 1.0  # of the prior at any gait
    noise: jax.Array | float = 1e-3  # variance of a trial about its gait's true fitness
    kappa: jax.Array | float = 0.05  # weight of the bonus for what is unknown
    sufficient: jax.Array | float = 0.9  # share of the best expected fitness at which the search ends


PUBLISHED = ProcessSettings()


class TrialState(NamedTuple):
    """What the robot has tried; only the first `count` of the T places mean something."""

    index: jax.Array  # i32[T] tested cell
    observed: jax.Array  # f32[T] its fitness on the damaged robot
    count: jax.Array  # i32[] trials so far
    faults: jax.Array  # i32[] of them with a non-finite outcome, taken for 0


def make_map(descriptors: np.ndarray | jax.Array, fitness: np.ndarray | jax.Array) -> GaitMap:
    """A map from concrete arrays f32[N, C] and f32[N], with their values checked.

    Raises:
        ValueError: no filled cell, shapes that do not fit, fitness of NaN or +inf, or a filled cell without descriptor.
    """
    prior = GaitMap(jnp.asarray(descriptors, jnp.float32), jnp.asarray(fitness, jnp.float32))
    check_shapes(prior)
    values, filled = np.asarray(prior.fitness), np.isfinite(prior.fitness)
    if np.any(np.isnan(values) | np.isposinf(values)):
        raise ValueError("fitness holds NaN or +inf; accepted are finite numbers, and -inf for an empty cell.")
    if not filled.any():
        raise ValueError(f"fitness has no filled cell among {len(values)} (all are -inf); at least one is needed.")
    if not np.isfinite(np.asarray(prior.descriptors)[filled]).all():
        raise ValueError("descriptors holds non-finite numbers at filled cells; finite ones are needed.")
    # An empty cell may have no descriptor, but NaN would spread from the kernel.
    return prior._replace(descriptors=jnp.where(jnp.isfinite(prior.descriptors), prior.descriptors, 0.0))


def init(trials: int) -> TrialState:
    """No trial yet, with room for T of them.

    Raises:
        ValueError: `trials` is below 1.
    """
    if trials < 1:
        raise ValueError(f"trials is {trials}; at least 1 is needed.")
    zero = jnp.zeros((), jnp.int32)
    return TrialState(jnp.zeros(trials, jnp.int32), jnp.zeros(trials), zero, zero)


def kernel(a: jax.Array, b: jax.Array, settings: ProcessSettings = PUBLISHED) -> jax.Array:
    """Matern-5/2 covariance f32[A, B] of descriptors f32[A, C] and f32[B, C]."""
    squared = jnp.sum((a[:, None] - b[None]) ** 2, axis=-1)
    d = jnp.sqrt(5.0 * squared) / settings.length
    return settings.variance * (1.0 + d + d**2 / 3.0) * jnp.exp(-d)


def posterior(prior: GaitMap, state: TrialState, settings: ProcessSettings = PUBLISHED) -> tuple[jax.Array, jax.Array]:
    """Mean and standard deviation f32[N] of every gait's fitness on the damaged robot.

    ``mu(x) = P(x) + k' (K + noise I)^-1 (y - P(X))`` and ``sigma^2(x) = variance - k' (K + noise I)^-1 k`` (Cully et
    al. 2015, Methods). Places beyond `count` enter as independent of all gaits, so the system has T rows whatever
    `count` is.

    Raises:
        ValueError: an empty map, or shapes that do not fit.
    """
    check_shapes(prior)
    tested, size = prior.descriptors[state.index], len(state.index)
    valid = jnp.arange(size) < state.count
    # The rounding of the factorisation itself, so that a gait tried twice without noise is no fault.
    ridge = settings.noise + size * jnp.finfo(jnp.float32).eps * settings.variance
    inner = jnp.where(valid[:, None] & valid[None], kernel(tested, tested, settings), 0.0)
    factor = jnp.linalg.cholesky(inner + jnp.diag(jnp.where(valid, ridge, 1.0)))
    across = jnp.where(valid[:, None], kernel(tested, prior.descriptors, settings), 0.0)  # [T, N]
    surprise = jnp.where(valid, state.observed - prior.fitness[state.index], 0.0)
    mean = prior.fitness + dot(cho_solve((factor, True), surprise), across)
    half = solve_triangular(factor, across, lower=True)
    variance = settings.variance - jnp.sum(half**2, axis=0)
    return mean, jnp.sqrt(jnp.maximum(variance, 0.0))


def suggest(
    prior: GaitMap, state: TrialState, settings: ProcessSettings = PUBLISHED, *, bonus: str = "deviation"
) -> jax.Array:
    """The cell i32[] to try next, ``argmax mu + kappa sigma``; with no trial yet, the map's best.

    Args:
        prior: the map.
        state: trials so far.
        settings: of the process.
        bonus: ``deviation`` is the published sigma; ``variance`` is sigma^2, as in two public re-implementations.

    Raises:
        ValueError: unknown `bonus`, an empty map, or shapes that do not fit.
    """
    return choose(*posterior(prior, state, settings), settings, bonus)


def record(state: TrialState, index: jax.Array, value: jax.Array) -> TrialState:
    """The state after cell `index` i32[] gave `value` f32[]; a non-finite value is a fault and counts as 0.

    A full state stays as it is.
    """
    room = state.count < len(state.index)
    finite = jnp.isfinite(value)
    return TrialState(
        index=state.index.at[state.count].set(jnp.asarray(index, jnp.int32), mode="drop"),
        observed=state.observed.at[state.count].set(jnp.where(finite, value, 0.0), mode="drop"),
        count=state.count + room,
        faults=state.faults + (room & ~finite),
    )


def best(state: TrialState) -> tuple[jax.Array, jax.Array]:
    """Cell i32[] and observed fitness f32[] of the best trial; -1 and -inf before the first."""
    valid = jnp.arange(len(state.index)) < state.count
    observed = jnp.where(valid, state.observed, -jnp.inf)
    place = jnp.argmax(observed)
    return jnp.where(state.count > 0, state.index[place], -1), observed[place]


def stopped(prior: GaitMap, state: TrialState, settings: ProcessSettings = PUBLISHED) -> jax.Array:
    """Whether the best trial has 0.9 (`sufficient`) of the highest posterior mean: bool[], False before the first.

    Raises:
        ValueError: an empty map, or shapes that do not fit.
    """
    return sufficient(posterior(prior, state, settings)[0], state, settings)


def choose(
    mean: jax.Array, deviation: jax.Array, settings: ProcessSettings = PUBLISHED, bonus: str = BONUSES[0]
) -> jax.Array:
    """`suggest` from a posterior that is at hand: mean and standard deviation f32[N]."""
    if bonus not in BONUSES:
        raise ValueError(f"bonus is {bonus!r}: choose one of {', '.join(BONUSES)}.")
    unknown = deviation if bonus == "deviation" else deviation**2
    return jnp.argmax(mean + settings.kappa * unknown).astype(jnp.int32)


def sufficient(mean: jax.Array, state: TrialState, settings: ProcessSettings = PUBLISHED) -> jax.Array:
    """`stopped` from a posterior mean f32[N] that is at hand."""
    return best(state)[1] >= settings.sufficient * jnp.max(mean)


def check_shapes(prior: GaitMap) -> None:
    """Refuses an empty map; values may be traced.

    Raises:
        ValueError: an empty map, or shapes that do not fit.
    """
    descriptors, fitness = jnp.shape(prior.descriptors), jnp.shape(prior.fitness)
    if len(descriptors) != 2 or fitness != descriptors[:1]:
        raise ValueError(f"descriptors has shape {descriptors} and fitness {fitness}; [N, C] and [N] are needed.")
    if 0 in descriptors:
        raise ValueError(f"the map is empty: descriptors has shape {descriptors}; at least one cell is needed.")
