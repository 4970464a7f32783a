"""How robots went on: speed kept, falls, and whether the damage and the right policy were found."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from experiments.recovering.rows import Case
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.recovery import Story
from srl_jax.atlas.robots import CRobot
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.statistics import iqm, stratified_interval

HZ = round(CONTROL_HZ)


def speed(body: CRobot, first: float, last: float) -> float:
    """m/s along its task from one second after the damage to another; a robot struck at once starts at second 0."""
    path = np.array([0.0, *body.come])
    return float(path[body.strike + round(HZ * last)] - path[body.strike + round(HZ * first)]) / (last - first)


def retained(bodies: Sequence[CRobot], window: tuple[float, float], standard: Sequence[float]) -> np.ndarray:
    """Share of the healthy speed f64[N] over seconds after the damage; 0 for a robot that fell at any time."""
    kept = np.array([speed(body, *window) / own for body, own in zip(bodies, standard, strict=True)])
    return np.where([body.fell for body in bodies], 0.0, kept)


def interval(shares: np.ndarray) -> str:
    """IQM and 95 % interval over robots."""
    low, high = stratified_interval(shares[:, None], iqm)
    return f"{iqm(shares):.2f} [{low:.2f}, {high:.2f}]"


def better(x: np.ndarray, y: np.ndarray) -> str:
    """Share of robots that kept more by one method than by another, and its 95 % interval; the same robots."""
    won = np.where(x == y, 0.5, x > y)[:, None]
    low, high = stratified_interval(won, np.mean)
    return f"{np.mean(won):.2f} [{low:.2f}, {high:.2f}]"


def named(atlas: Atlas, lots: Sequence[Case], bodies: Sequence[CRobot], story: Story, seconds: float) -> tuple:
    """How often the damage was thought of first, and how often a policy as good as the best usable one walked.

    As good: within 10 % by the matrix, or learned for it; among robots whose damage the atlas has. NaN: there is none.
    """
    right, good = [], []
    for i, (lot, body) in enumerate(zip(lots, bodies, strict=True)):
        step = body.strike + round(seconds * HZ)
        likeliest, policy = int(np.argmax(story.log_belief[step, i, :-1])), int(story.policy[step, i])
        names = [*atlas.damages, *story.twins[i]]
        right.append(likeliest < len(names) and names[likeliest] == body.damage)
        if body.damage in atlas.damages:
            column = atlas.value[:, atlas.damages.index(body.damage)]
            usable = np.array([name not in lot.without for name in atlas.trained_for])
            good.append(policy >= len(column) or column[policy] >= 0.9 * column[usable].max())
    return float(np.mean(right)), float(np.mean(good)) if good else np.nan


def alarms(bodies: Sequence[CRobot], story: Story) -> float:
    """Share of robots that took themselves for damaged at some step before they were; at any, if they never were."""
    healthy = np.exp(story.log_belief[:, :, 0])
    ends = [len(healthy) if body.damage == HEALTHY else body.strike + 1 for body in bodies]
    return float(np.mean([healthy[:end, i].min() < 0.5 for i, end in enumerate(ends)]))


def curve(bodies: Sequence[CRobot], seconds: np.ndarray, standard: Sequence[float], width: float = 1.0) -> np.ndarray:
    """IQM over robots of the share kept in the `width` seconds before each second after the damage, f64[T]."""
    points = [retained(bodies, (max(second - width, 0.0), second), standard) for second in seconds]
    return np.array([iqm(kept) for kept in points])


def calibration(bodies: Sequence[CRobot], story: Story, settle: int = 40) -> tuple[float, float, int]:
    """Of segments that began and ended after the damage: coverage of 95 % intervals, and concordance; how many.

    Concordance: of two segments of one robot, how often the one of which more was expected was worth more (AUC).
    """
    worth, mean, deviation = story.ended.worth, story.ended.forecast.mean, story.ended.forecast.deviation
    inside, right = [], []
    for i, body in enumerate(bodies):
        rows = np.flatnonzero(np.isfinite(worth[:, i]) & np.isfinite(mean[:, i]))
        rows = rows[rows >= body.strike + settle]
        inside += (np.abs(worth[rows, i] - mean[rows, i]) <= 1.96 * deviation[rows, i]).tolist()
        for first, second in combinations(rows, 2):
            gap = mean[second, i] - mean[first, i]
            if abs(gap) > 0.05:
                right.append((gap > 0) == (worth[second, i] > worth[first, i]))
    return float(np.mean(inside)) if inside else np.nan, float(np.mean(right)) if right else np.nan, len(inside)
