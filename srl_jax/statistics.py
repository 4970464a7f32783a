"""Statistics over seeds and conditions, after Agarwal et al. 2021.

"Deep Reinforcement Learning at the Edge of the Statistical Precipice". Scores are arrays [seeds, conditions].
Seeds are the random unit and conditions are strata: the bootstrap resamples seeds within each condition and
never mixes conditions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import trim_mean

FloatArray = NDArray[np.float64]
DRAWN_AT_ONCE = 1 << 22  # numbers of a bootstrap that are held at once


class Interval(NamedTuple):
    """A bootstrap interval."""

    low: float
    high: float


class Estimate(NamedTuple):
    """A point estimate with its bootstrap interval."""

    point: float
    low: float
    high: float


class Curve(NamedTuple):
    """A point estimate and its interval at each of T steps."""

    centre: FloatArray  # [T]
    low: FloatArray  # [T]
    high: FloatArray  # [T]


def _checked(values: ArrayLike, name: str, ndim: int | None = None) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if ndim is not None and array.ndim != ndim:
        raise ValueError(f"{name} must have {ndim} axes, but its shape is {array.shape}.")
    if array.size == 0:
        raise ValueError(f"{name} is empty (shape {array.shape}); at least one value is needed.")
    missing = int(np.isnan(array).sum())
    if missing:
        raise ValueError(
            f"{name} holds {missing} NaN among {array.size} values; report the lanes that went non-finite "
            "and decide how they count before taking statistics."
        )
    return array


def _ends(samples: FloatArray, confidence: float) -> FloatArray:
    # [..., 2] of samples [..., R]: order statistics rather than interpolation, so that inf ("never reached") stays inf.
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}; it must lie strictly between 0 and 1.")
    ordered = np.sort(samples, axis=-1)
    tail = round((1.0 - confidence) / 2.0 * (ordered.shape[-1] - 1))
    return ordered[..., [tail, -1 - tail]]


def _resampled_seeds(shape: tuple[int, int], resamples: int, seed: int) -> NDArray[np.int64]:
    # [resamples, seeds, conditions]: which seed stands in each place, drawn anew for every condition.
    return _generator(resamples, seed).integers(shape[0], size=(resamples, *shape))


def _generator(resamples: int, seed: int) -> np.random.Generator:
    if resamples < 1:
        raise ValueError(f"resamples is {resamples}; at least one is needed.")
    return np.random.default_rng(seed)


@overload
def iqm(values: ArrayLike, axis: None = None) -> float: ...
@overload
def iqm(values: ArrayLike, axis: int) -> FloatArray: ...
def iqm(values: ArrayLike, axis: int | None = None) -> float | FloatArray:
    """Interquartile mean: the mean of the middle half of the values.

    Args:
        values: any shape; inf is allowed and stays inf unless trimmed.
        axis: axis to reduce; None reduces all of them.

    Raises:
        ValueError: a value is NaN, or there is none.
    """
    array = _checked(values, "values")
    if axis is None:
        return float(trim_mean(array.ravel(), 0.25))
    return np.asarray(trim_mean(array, 0.25, axis=axis), dtype=np.float64)


def stratified_interval(
    scores: ArrayLike,
    statistic: Callable[..., Any] = iqm,
    confidence: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """Percentile interval of a pooled statistic by the stratified bootstrap (Agarwal et al. 2021, Sec. 4.1).

    Args:
        scores: [seeds, conditions].
        statistic: `statistic(array, axis=-1)`, such as `iqm` or `numpy.mean`, of [..., seeds * conditions].
        confidence: mass of the interval, in (0, 1).
        resamples: number of bootstrap draws.
        seed: of the bootstrap's own generator.

    Raises:
        ValueError: a score is NaN, or an argument lies outside its range.
    """
    array = _checked(scores, "scores", ndim=2)
    return Interval(*stratified_intervals(array[None], statistic, confidence, resamples, seed)[0].tolist())


def stratified_intervals(
    scores: ArrayLike,
    statistic: Callable[..., Any] = iqm,
    confidence: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> FloatArray:
    """`stratified_interval` of each of K tables of scores [K, seeds, conditions], with the same draws of seeds.

    Returns the low and high ends [K, 2]; arguments and errors are those of the single one.
    """
    array = _checked(scores, "scores", ndim=3)
    tables, seeds, conditions = array.shape
    index = _resampled_seeds((seeds, conditions), resamples, seed) * conditions + np.arange(conditions)
    at_once = max(DRAWN_AT_ONCE // index.size, 1)
    ends = np.empty((tables, 2))
    for first in range(0, tables, at_once):
        part = array[first : first + at_once].reshape(-1, seeds * conditions)
        drawn = np.take(part, index.reshape(resamples, -1), axis=1)
        ends[first : first + at_once] = _ends(np.asarray(statistic(drawn, axis=-1), dtype=np.float64), confidence)
    return ends


def iqm_curve(values: ArrayLike, confidence: float = 0.95, resamples: int = 2000, seed: int = 0) -> Curve:
    """Interquartile mean and pointwise stratified bootstrap interval at every step.

    Args:
        values: [T, seeds, conditions].
        confidence, resamples, seed: as in `stratified_interval`; the draws of seeds are shared by all T.
    """
    array = _checked(values, "values", ndim=3)
    ends = stratified_intervals(array, iqm, confidence, resamples, seed)
    return Curve(iqm(array.reshape(len(array), -1), axis=-1), ends[:, 0], ends[:, 1])


def probability_of_improvement(
    x: ArrayLike, y: ArrayLike, confidence: float = 0.95, resamples: int = 2000, seed: int = 0
) -> Estimate:
    """Probability that a run of X scores higher than a run of Y, averaged over conditions.

    P(X > Y) + P(X = Y) / 2 per condition is the Mann-Whitney statistic (Agarwal et al. 2021, Sec. 4.3).
    Seeds of X and of Y are resampled independently within each condition.

    Args:
        x, y: [seeds, conditions] each; the number of seeds may differ.
        confidence, resamples, seed: as in `stratified_interval`.

    Raises:
        ValueError: a score is NaN, or the numbers of conditions differ.
    """
    x, y = _checked(x, "x", ndim=2), _checked(y, "y", ndim=2)
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"x has {x.shape[1]} conditions and y has {y.shape[1]}; both need the same ones.")
    left, right = x.T[:, :, None], y.T[:, None, :]
    wins = (left > right) + 0.5 * (left == right)  # [C, Sx, Sy]
    rng = _generator(resamples, seed)
    shares = []  # how often each seed was drawn, as a fraction: [C, resamples, S]
    for seeds in (len(x), len(y)):
        drawn = rng.multinomial(seeds, np.full(seeds, 1 / seeds), (resamples, len(wins)))
        shares.append(drawn.swapaxes(0, 1) / seeds)
    drawn = ((shares[0] @ wins) * shares[1]).sum(-1).mean(0)
    return Estimate(float(wins.mean()), *_ends(drawn, confidence).tolist())


def performance_profile(scores: ArrayLike, taus: ArrayLike) -> FloatArray:
    """Fraction of runs that score above each threshold (Agarwal et al. 2021, Sec. 4.2).

    Args:
        scores: [seeds, conditions], or any shape.
        taus: [K] thresholds, in the unit of the scores.

    Returns:
        [K] fractions in [0, 1], non-increasing in tau.

    Raises:
        ValueError: a score or a threshold is NaN.
    """
    flat = np.sort(_checked(scores, "scores"), axis=None)
    above = flat.size - np.searchsorted(flat, _checked(taus, "taus", ndim=1), side="right")
    return above / flat.size


def _checked_series(steps: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    steps, values = _checked(steps, "steps", ndim=1), _checked(values, "values")
    if values.shape[:1] != steps.shape:
        raise ValueError(f"values has shape {values.shape}; its first axis must hold the {len(steps)} steps.")
    if np.any(np.diff(steps) <= 0):
        raise ValueError("steps must increase strictly.")
    return steps, values


def area_under_curve(steps: ArrayLike, values: ArrayLike) -> FloatArray:
    """Mean height of a learning curve: trapezoid area over the range of steps.

    Args:
        steps: [T], strictly increasing; a single step returns its value.
        values: [T, ...].

    Returns:
        [...], in the unit of the values.

    Raises:
        ValueError: a value is NaN, or the steps do not match or increase.
    """
    steps, values = _checked_series(steps, values)
    if len(steps) == 1:
        return values[0]
    return np.asarray(np.trapezoid(values, steps, axis=0)) / (steps[-1] - steps[0])


def steps_to_threshold(steps: ArrayLike, values: ArrayLike, threshold: ArrayLike) -> FloatArray:
    """First evaluation step at which a curve is at or above a threshold; inf where it never is.

    Args:
        steps, values: [T], strictly increasing, and [T, ...].
        threshold: one for all, or [...] one for each curve, in the unit of the values; inf is never reached.

    Returns:
        [...] steps, one of the given ones or inf.

    Raises:
        ValueError: a value or a threshold is NaN, the steps do not match or increase, or the thresholds do not match.
    """
    steps, values = _checked_series(steps, values)
    limit = _checked(threshold, "threshold")
    if limit.ndim and limit.shape != values.shape[1:]:
        raise ValueError(f"threshold has shape {limit.shape}; one number or {values.shape[1:]} is accepted.")
    reached = (values >= limit) & np.isfinite(limit)
    return np.where(reached.any(axis=0), steps[reached.argmax(axis=0)], np.inf)
