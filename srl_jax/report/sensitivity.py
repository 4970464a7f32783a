"""How much a swept setting matters: a score against its values, over every lane that has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srl_jax import statistics
from srl_jax.report import style
from srl_jax.report.data import Group, RunData
from srl_jax.report.style import STYLE
from srl_jax.report.summary import lane_scores


class Entry(NamedTuple):
    """A setting of an algorithm at one value: interquartile mean and 95 % interval."""

    algo: str
    setting: str
    value: str
    lanes: int
    iqm: float
    low: float
    high: float


def entries(run: RunData, resamples: int = 2000) -> list[Entry]:
    """Area under success (p2p) or under return, for every value of every setting that several values were given.

    Where several settings were swept, a value's lanes have all values of the others: its main effect.

    Raises:
        ValueError: lanes do not fill seeds x damages, or rows are missing.
    """
    chosen = {group: dict(part.split("=", 1) for part in group.variant.split()) for group in run.groups}
    name = "area_success" if run.task == "p2p" else "area_return"
    scores = {group: found[name] for group in run.groups if name in (found := lane_scores(run, group))}
    result = []
    for algo in dict.fromkeys(group.algo for group in scores):
        own = {group: chosen[group] for group in scores if group.algo == algo}
        for setting in dict.fromkeys(key for values in own.values() for key in values):
            for value in sorted({values[setting] for values in own.values() if setting in values}, key=_order):
                groups = [group for group, values in own.items() if values.get(setting) == value]
                result.append(_entry(algo, setting, value, groups, scores, resamples))
    return result


def _entry(
    algo: str, setting: str, value: str, groups: Sequence[Group], scores: dict[Group, np.ndarray], resamples: int
) -> Entry:
    # Seeds are drawn, as everywhere: other settings and damages are conditions of a seed.
    values = np.concatenate([scores[group] for group in groups], axis=1)
    low, high = statistics.stratified_intervals(values[None], statistics.iqm, resamples=resamples)[0]
    return Entry(algo, setting, value, values.size, float(statistics.iqm(values)), float(low), float(high))


def _order(value: str) -> tuple[float, str]:
    """Numbers by size, then words."""
    try:
        return float(value), ""
    except ValueError:
        return math.inf, value


def save_figure(found: Sequence[Entry], path: str | Path, label: str) -> None:
    """One panel a setting: the score against its values, with intervals."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    settings = list(dict.fromkeys(entry.setting for entry in found))
    with rc_context(STYLE):
        figure = Figure(figsize=(4.0 * len(settings), 3.2), dpi=150, layout="constrained")
        for axes, setting in zip(figure.subplots(1, len(settings), squeeze=False)[0], settings, strict=True):
            own = [entry for entry in found if entry.setting == setting]
            ticks = list(dict.fromkeys(entry.value for entry in own))
            for algo in dict.fromkeys(entry.algo for entry in own):
                part = [entry for entry in own if entry.algo == algo]
                x = [ticks.index(entry.value) for entry in part]
                middle = np.array([entry.iqm for entry in part])
                ends = np.array([[e.iqm - e.low, e.high - e.iqm] for e in part]).T.clip(min=0.0)
                axes.errorbar(x, middle, ends, marker="o", capsize=3, label=algo)
            axes.margins(x=0.1)
            axes.set(xticks=range(len(ticks)), xticklabels=ticks, xlabel=setting.replace("_", " "), ylabel=label)
            axes.legend(frameon=False)
        style.save(figure, path)
