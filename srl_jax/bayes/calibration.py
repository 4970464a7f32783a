"""Is a posterior as wide as its errors? Coverage of credible intervals, and spread inside and outside the data.

Draws may come from anywhere (dropout masks, members, an exact posterior); the truths are what they claim to predict.
Draws of a mean are to be compared with true means: to cover noisy observations, such as returns, add the noise to them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

FloatArray = NDArray[np.float64]
LEVELS = (0.5, 0.8, 0.95)


class Spread(NamedTuple):
    """Predictive standard deviation (root of the mean variance), in the unit of the draws."""

    inside: float
    outside: float


def _checked(draws: ArrayLike, least: int) -> FloatArray:
    array = np.asarray(draws, np.float64)
    if array.ndim != 2 or array.shape[0] < least or array.shape[1] < 1:
        raise ValueError(f"draws has shape {array.shape}; it must be [M, N] with M at least {least} and N at least 1.")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"draws holds {int((~np.isfinite(array)).sum())} values that are not finite.")
    return array


def central_level(draws: ArrayLike, truths: ArrayLike, estimator: str = "rank") -> FloatArray:
    """Mass of the smallest central interval of each prediction that holds its truth: [N] in [0, 1].

    Uniform for a calibrated posterior; small where truths crowd at the median, near 1 where they lie outside the draws.

    Args:
        draws: [M, N] predictive draws for N questions.
        truths: [N].
        estimator: ``rank`` takes the rank of the truth among its draws, ties in the middle (Talts et al. 2018): exact
            for any distribution, in steps of 2 / (M + 1). ``gaussian`` takes the mean and variance of the draws as
            known, for few of them: with M = 5 even draws from the truth's own distribution cover .85 at .95.

    Raises:
        ValueError: M is 0 (2 for gaussian), shapes disagree, a number is not finite, or the estimator is unknown.
    """
    if estimator not in ("rank", "gaussian"):
        raise ValueError(f"estimator is {estimator!r}: choose rank or gaussian.")
    array, truth = _checked(draws, 1 if estimator == "rank" else 2), np.asarray(truths, np.float64)
    if truth.shape != array.shape[1:] or not np.all(np.isfinite(truth)):
        raise ValueError(
            f"truths has shape {truth.shape}; it must hold {array.shape[1]} finite values, one a question."
        )
    if estimator == "gaussian":
        mean, deviation = array.mean(0), array.std(0, ddof=1)
        error = np.abs(truth - mean)
        certain = deviation == 0.0  # then the interval is a point, which holds its own value alone
        z = np.where(certain, np.where(error == 0.0, 0.0, np.inf), error / np.where(certain, 1.0, deviation))
        return 2.0 * norm.cdf(z) - 1.0
    rank = 0.5 * ((array < truth[None]).sum(0) + (array <= truth[None]).sum(0))
    return np.abs(2.0 * (rank + 0.5) / (len(array) + 1) - 1.0)


def coverage(draws: ArrayLike, truths: ArrayLike, levels: ArrayLike = LEVELS, estimator: str = "rank") -> FloatArray:
    """Fraction of truths inside the central credible interval of each level.

    Args:
        draws: as in `central_level`.
        truths: as there.
        levels: [L] in (0, 1). By rank the level must be below M / (M + 1): M draws have no wider interval.
        estimator: as there.

    Returns:
        [L]; equal to the levels for a calibrated posterior, below them for one that is too sure.

    Raises:
        ValueError: as `central_level`, and for a level outside its range.
    """
    wanted = np.atleast_1d(np.asarray(levels, np.float64))
    smallest = central_level(draws, truths, estimator)
    count = len(np.asarray(draws))
    most = count / (count + 1) if estimator == "rank" else 1.0
    if not np.all((wanted > 0.0) & (wanted < most)):
        raise ValueError(f"levels is {wanted}; each must lie above 0 and below {most:.4g}.")
    return (smallest[None] <= wanted[:, None] + 1e-9).mean(1)  # a rank may lie on the interval's very end


def expected_error(probability: ArrayLike, outcome: ArrayLike, bins: int = 10) -> float:
    """Expected calibration error of probabilities: how far they lie from frequencies (Naeini et al. 2015).

    ``sum_b n_b / n |mean outcome - mean probability|`` over bins of equal width; 0 for a calibrated one, up to noise.

    Args:
        probability: [n] in [0, 1].
        outcome: bool[n].
        bins: how many, at least 1.

    Raises:
        ValueError: shapes disagree, n is 0, a probability lies outside [0, 1], or there is no bin.
    """
    claimed, came = np.asarray(probability, np.float64), np.asarray(outcome)
    if claimed.ndim != 1 or not claimed.size or came.shape != claimed.shape or came.dtype != bool or bins < 1:
        raise ValueError(
            f"probability has shape {claimed.shape}, outcome is {came.dtype}{list(came.shape)} and bins {bins}; they "
            "must be [n] and bool[n] with n at least 1, and at least 1."
        )
    if not np.all((claimed >= 0.0) & (claimed <= 1.0)):
        raise ValueError(f"probability lies in {claimed.min():g}..{claimed.max():g}; it must lie in 0..1.")
    place = np.minimum((claimed * bins).astype(int), bins - 1)
    return float(np.abs(np.bincount(place, came - claimed, bins)).sum() / claimed.size)


def spread(draws: ArrayLike, inside: ArrayLike) -> Spread:
    """Predictive standard deviation where there were data and where there were none.

    Args:
        draws: [M, N], M at least 2.
        inside: bool[N], with both kinds present; who is inside is the caller's to say.

    Raises:
        ValueError: shapes disagree, a draw is not finite, or one kind is missing.
    """
    variance, mask = _checked(draws, 2).var(0, ddof=1), np.asarray(inside)
    if mask.dtype != bool or mask.shape != variance.shape or mask.all() or not mask.any():
        raise ValueError(
            f"inside is {mask.dtype}{list(mask.shape)} with {int(mask.sum())} true; "
            f"it must be bool[{variance.size}] with both kinds present."
        )
    return Spread(float(np.sqrt(variance[mask].mean())), float(np.sqrt(variance[~mask].mean())))
