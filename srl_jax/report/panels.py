"""One panel of a figure: a run's learning curves, what they are measured against, and its axes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from srl_jax.report.data import RunData
from srl_jax.report.style import Looks, thousands
from srl_jax.statistics import iqm, iqm_curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

CONTROL_HZ = 20.0
DRAWS = 4_000_000  # numbers that the bootstrap of one evaluation may draw: its time grows with the lanes
LABELS = {
    "eval/success": "success rate",
    "eval/return": "return per episode",
    "eval/distance": "distance per episode (m)",
}


def _curves(axes: Axes, run: RunData, metric: str, looks: Looks, damage: str | None = None) -> None:
    # `damage` None pools all of them; SRL lies on top, what has no name at the bottom and without a band.
    for group, look in looks.items():
        named = "label" in look
        series = run.scores(metric, group) if named or damage is None else None
        if series is None or (damage is not None and damage not in series.conditions):
            continue
        columns = slice(None) if damage is None else [series.conditions.index(damage)]
        values = series.values[:, :, columns]
        marker = "o" if len(series.steps) == 1 else ""
        if not named:
            centre = iqm(values.reshape(len(values), -1), axis=1)
            axes.plot(series.steps, centre, **look, marker=marker, linewidth=0.9, zorder=2.2)
            continue
        curve = iqm_curve(values, resamples=int(np.clip(DRAWS // values[0].size, 200, 2000)))
        width, above = 2.2 if damage is None else 1.5, 2.6 if group == ("srl", "") else 2.5
        axes.plot(series.steps, curve.centre, **look, marker=marker, linewidth=width, zorder=above)
        axes.fill_between(series.steps, curve.low, curve.high, color=look["color"], alpha=0.16, linewidth=0)


def _references(axes: Axes, run: RunData, metric: str, damage: str | None = None) -> dict[str, float]:
    # Draws the reference lines and returns their names and their heights at the end.
    lines: dict[str, float] = {}
    if stages := _teacher(run, metric.replace("eval/", "teacher/"), damage):
        look: Any = {"color": "#555555", "linestyle": (0, (6, 3)), "linewidth": 1.2, "zorder": 1}
        starts, heights = [start for start, _ in stages], [height for _, height in stages]
        if len(stages) == 1:
            axes.axhline(heights[0], **look)
        else:  # each stage of a damage schedule has a height of its own, in force until the next
            end = max(int(rows.steps[-1]) for name, rows in run.metrics.items() if name.startswith("eval/"))
            axes.plot([*starts, max(end, starts[-1])], [*heights, heights[-1]], drawstyle="steps-post", **look)
        lines["frozen $\\pi_B$"] = heights[-1]
    if metric == "eval/return" and run.finish is not None:
        lines["finish"] = run.finish
        axes.axhline(run.finish, color="#111111", linestyle=":", linewidth=1.6, zorder=1)
    return lines


def _teacher(run: RunData, metric: str, damage: str | None) -> list[tuple[int, float]]:
    # The steps at which pi_B was measured, and its interquartile means there.
    rows = run.metrics.get(metric)
    if rows is None:
        return []
    own = [column for column, lane in enumerate(run.lanes) if damage in (None, lane["damage"])]
    found = [(int(step), row[np.isfinite(row)]) for step, row in zip(rows.steps, rows.values[:, own], strict=True)]
    return [(step, iqm(values)) for step, values in found if values.size]


def large(axes: Axes, run: RunData, metric: str, looks: Looks, title: str = "") -> None:
    """Draws a metric of a run, all seeds and damages pooled, with names at the reference lines."""
    _curves(axes, run, metric, looks)
    lines = _references(axes, run, metric)
    _scale(axes, metric)
    axes.set_title(title or LABELS[metric], loc="left", fontsize=12, fontweight="bold", color="#222222")
    axes.set_xlabel("environment steps per lane, and robot time at 20 Hz")
    axes.locator_params(axis="x", nbins=6)
    axes.xaxis.set_major_formatter(lambda x, _: f"{thousands(x)}\n{_minutes(x)}")
    # Names stand in the right margin, off the data, and are pushed apart where the lines lie close.
    low, high = axes.get_ylim()
    apart, last = 0.05 * (high - low), -math.inf
    for name, height in sorted(lines.items(), key=lambda item: item[1]):
        last = max(height, last + apart)
        place = {"xycoords": axes.get_yaxis_transform(), "textcoords": "offset points"}
        axes.annotate(name, (1, last), (5, 0), va="center", **place)


def small(
    figure: SubFigure, run: RunData, metric: str, damages: list[str], shape: tuple[int, int], looks: Looks
) -> None:
    """Draws a metric of a run in one small panel per damage, in rows x columns of them."""
    rows, columns = shape
    # Limits are set once at the end: axes that share them tell all others at every change, the square of their number.
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, damage in itertools.zip_longest(grid.flat, damages):
        if damage is None:
            axes.set_axis_off()
            continue
        one(axes, run, metric, damage, looks)
        axes.label_outer()
    panels = list(grid.flat)[: len(damages)]
    share_limits(panels)
    for axes in panels[-columns:]:  # a panel with an empty place below it shows the steps itself
        axes.tick_params(labelbottom=True)
    figure.supylabel(LABELS[metric], fontsize=10)


def one(axes: Axes, run: RunData, metric: str, damage: str, looks: Looks) -> None:
    """Draws a metric of a run under one damage."""
    _curves(axes, run, metric, looks, damage)
    _references(axes, run, metric, damage)
    _scale(axes, metric)
    axes.set_title(damage, fontsize=9.5, color="#222222")
    axes.locator_params(axis="x", nbins=3)
    axes.xaxis.set_major_formatter(lambda x, _: thousands(x))
    axes.tick_params(labelsize=8.5)


def share_limits(panels: Sequence[Axes]) -> None:
    """Gives panels, which may stand in figures of their own, the limits that hold all of them."""
    x, y = (np.array([getattr(axes, f"get_{name}lim")() for axes in panels]) for name in "xy")
    for axes in panels:
        axes.set(xlim=(x[:, 0].min(), x[:, 1].max()), ylim=(y[:, 0].min(), y[:, 1].max()))


def _scale(axes: Axes, metric: str) -> None:
    axes.margins(x=0.02)
    if metric == "eval/success":
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks(np.linspace(0, 1, 6))


def _minutes(steps: float) -> str:
    minutes = steps / CONTROL_HZ / 60
    return f"{minutes:.0f} min" if minutes >= 10 or minutes == 0 else f"{minutes:.2g} min"
