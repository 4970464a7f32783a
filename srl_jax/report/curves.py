"""Shows a run: learning curves as one PNG, in the manner of the paper's figure, and the closing table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from srl_jax.statistics import iqm, iqm_curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    from srl_jax.report.data import Group, RunData

CONTROL_HZ = 20.0
NAMES = {"ddpg": "DDPG", "srl": "SRL", "acteach": "AC-Teach"}
# Okabe & Ito: told apart with common colour blindness. The paper's two methods look the same in all runs.
FIXED = {"srl": "#0072B2", "ddpg": "#D55E00"}
PALETTE = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444", "#0072B2", "#D55E00")
LABELS = {
    "eval/success": "success rate",
    "eval/return": "return per episode",
    "eval/distance": "distance per episode (m)",
}
STYLE: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": "#222222",
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
}
Looks = Mapping["Group", Mapping[str, Any]]


def save_curves(run: RunData, path: str | Path) -> None:
    """Draws interquartile means with 95 % bands against environment steps.

    Two large panels pool seeds and damages (success and return for `p2p`, return and distance otherwise),
    with the frozen behaviour policy dashed and the `finish` threshold dotted. One small panel per damage
    follows where there are several. Below the steps stands robot time at 20 Hz.

    Args:
        run: from `report.read_metrics`.
        path: the PNG to write.

    Raises:
        ValueError: the run has neither of the two metrics, or its lanes do not fill seeds x damages.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    metrics = ("eval/success", "eval/return") if run.task == "p2p" else ("eval/return", "eval/distance")
    metrics = tuple(metric for metric in metrics if run.metrics.get(metric))
    if not metrics:
        raise ValueError(f"Nothing to draw: the run of task '{run.task}' has no eval/return and the like.")
    damages = list(dict.fromkeys(lane["damage"] for lane in run.lanes))
    columns = 7 if len(damages) > 12 else min(len(damages), 6)
    rows = math.ceil(len(damages) / columns) if len(damages) > 1 else 0
    looks = _looks(run.groups)
    with rc_context(STYLE):
        figure = Figure(
            figsize=(11.5, 5.0 + 2.1 * rows), dpi=150, layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08)
        )
        heights = (5.0, 2.1 * rows) if rows else (1.0,)
        parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, metric in zip(parts[0].subplots(1, len(metrics), squeeze=False)[0], metrics, strict=True):
            _large(axes, run, metric, looks)
        if rows:
            _small(parts[1], run, metrics[0], damages, (rows, columns), looks)
        handles, labels = parts[0].axes[0].get_legend_handles_labels()
        seeds = len({lane["seed"] for lane in run.lanes})
        pooled = f"{_counted(seeds, 'seed')} × {_counted(len(damages), 'damage')}"
        legend = figure.legend(
            handles,
            labels,
            loc="outside upper left",
            ncols=min(len(labels), 6),
            fontsize=11,
            columnspacing=2.5,
        )
        legend.set_title(f"Task {run.task}: interquartile mean of {pooled}, 95 % bootstrap band")
        legend.set_alignment("left")
        figure.savefig(path, format="png")


def _looks(groups: Iterable[Group]) -> dict[Group, dict[str, Any]]:
    # Dashed and dotted are kept for the reference lines.
    styles = itertools.product(("-", "-.", (0, (7, 1.5))), PALETTE)
    fixed = {group: FIXED[group.algo] for group in groups if group.algo in FIXED and not group.variant}
    free = (look for look in styles if look[0] != "-" or look[1] not in fixed.values())
    looks: dict[Group, dict[str, Any]] = {}
    for group in groups:
        style, colour = ("-", fixed[group]) if group in fixed else next(free, ("-", "#999999"))
        name = f"{NAMES.get(group.algo, group.algo)} {group.variant}".strip()
        looks[group] = {"linestyle": style, "color": colour, "label": name}
    return looks


def _curves(axes: Axes, run: RunData, metric: str, looks: Looks, damage: str | None = None) -> None:
    # `damage` None pools all of them; SRL lies on top.
    for group, look in looks.items():
        series = run.scores(metric, group)
        if series is None or (damage is not None and damage not in series.conditions):
            continue
        columns = slice(None) if damage is None else [series.conditions.index(damage)]
        curve = iqm_curve(series.values[:, :, columns])
        marker = "o" if len(series.steps) == 1 else ""
        width, above = 2.2 if damage is None else 1.5, 2.6 if group == ("srl", "") else 2.5
        axes.plot(series.steps, curve.centre, **look, marker=marker, linewidth=width, zorder=above)
        axes.fill_between(series.steps, curve.low, curve.high, color=look["color"], alpha=0.16, linewidth=0)


def _references(axes: Axes, run: RunData, metric: str, damage: str | None = None) -> dict[str, float]:
    # Draws the horizontal lines and returns their names and heights.
    lanes = {lane["lane"] for lane in run.lanes if damage in (None, lane["damage"])}
    rows = run.metrics.get(metric.replace("eval/", "teacher/"), {})
    values = [value for row in rows.values() for lane, value in row.items() if lane in lanes]
    teacher = [value for value in values if math.isfinite(value)]
    lines: dict[str, float] = {}
    if teacher:
        height = lines["frozen $\\pi_B$"] = iqm(teacher)
        axes.axhline(height, color="#555555", linestyle=(0, (6, 3)), linewidth=1.2, zorder=1)
    if metric == "eval/return" and run.finish is not None:
        lines["finish"] = run.finish
        axes.axhline(run.finish, color="#111111", linestyle=":", linewidth=1.6, zorder=1)
    return lines


def save_panels(runs: Sequence[RunData], metric: str, path: str | Path) -> None:
    """Draws one large panel per run, side by side, as in the paper's figure.

    Args:
        runs: from `report.read_metrics`, typically one per task.
        metric: such as ``eval/return``.
        path: the PNG to write.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    groups = dict.fromkeys(group for run in runs for group in run.groups)
    looks = _looks(groups)
    with rc_context(STYLE):
        figure = Figure(figsize=(5.2 * len(runs), 4.4), dpi=150, layout="constrained")
        for axes, run in zip(figure.subplots(1, len(runs), squeeze=False)[0], runs, strict=True):
            _large(axes, run, metric, looks, title=f"{run.task}: {LABELS[metric]}")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), fontsize=11)
        figure.savefig(path, format="png")


def _large(axes: Axes, run: RunData, metric: str, looks: Looks, title: str = "") -> None:
    _curves(axes, run, metric, looks)
    lines = _references(axes, run, metric)
    _scale(axes, metric)
    axes.set_title(title or LABELS[metric], loc="left", fontsize=12, fontweight="bold", color="#222222")
    axes.set_xlabel("environment steps per lane, and robot time at 20 Hz")
    axes.locator_params(axis="x", nbins=6)
    axes.xaxis.set_major_formatter(lambda x, _: f"{_thousands(x)}\n{_minutes(x)}")
    # Names stand in the right margin, off the data, and are pushed apart where the lines lie close.
    low, high = axes.get_ylim()
    apart, last = 0.05 * (high - low), -math.inf
    for name, height in sorted(lines.items(), key=lambda item: item[1]):
        last = max(height, last + apart)
        place = {"xycoords": axes.get_yaxis_transform(), "textcoords": "offset points"}
        axes.annotate(name, (1, last), (5, 0), va="center", **place)


def _small(
    figure: SubFigure, run: RunData, metric: str, damages: list[str], shape: tuple[int, int], looks: Looks
) -> None:
    rows, columns = shape
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, damage in itertools.zip_longest(grid.flat, damages):
        if damage is None:
            axes.set_axis_off()
            continue
        _curves(axes, run, metric, looks, damage)
        _references(axes, run, metric, damage)
        _scale(axes, metric)
        axes.set_title(damage, fontsize=9.5, color="#222222")
        axes.locator_params(axis="x", nbins=3)
        axes.xaxis.set_major_formatter(lambda x, _: _thousands(x))
        axes.tick_params(labelsize=8.5)
    for column in range(columns):  # a panel with an empty place below it shows the steps itself
        lowest = (len(damages) - 1 - column) // columns
        if lowest >= 0:
            grid[lowest, column].tick_params(labelbottom=True)
    figure.supylabel(LABELS[metric], fontsize=10)


def _scale(axes: Axes, metric: str) -> None:
    axes.margins(x=0.02)
    if metric == "eval/success":
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks(np.linspace(0, 1, 6))


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _thousands(steps: float) -> str:
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if abs(steps) >= unit:
            return f"{steps / unit:.4g}{name}"
    return f"{steps:.4g}"


def _minutes(steps: float) -> str:
    minutes = steps / CONTROL_HZ / 60
    return f"{minutes:.0f} min" if minutes >= 10 or minutes == 0 else f"{minutes:.2g} min"


def format_table(summary: Mapping[str, Any]) -> list[list[str]]:
    """Rows of text for a closing table; the first one is the header.

    The columns are method, success, return, area, retained and steps to finish, each `.93 [.91, .95]`; `-`
    stands for what was not recorded and `never` for a threshold that was not reached. The area is that under
    success for `p2p` and under return otherwise.

    Args:
        summary: from `report.summarise`.
    """
    area = "area_success" if summary["task"] == "p2p" else "area_return"
    keys = ("success", "return", area, "retained", "steps_to_finish")
    rows = [["method", "success", "return", "area", "retained", "steps to finish"]]
    for label, method in summary["methods"].items():
        rows.append([label, *(_cell(key, method["overall"].get(key)) for key in keys)])
    return rows


def _cell(key: str, entry: Mapping[str, float | None] | None) -> str:
    if entry is None:
        return "-"
    numbers = [entry["iqm"], entry["low"], entry["high"]]
    largest = max((abs(number) for number in numbers if number is not None), default=0.0)
    decimals = 2 if largest < 10 else 1 if largest < 100 else 0

    def text(number: float | None) -> str:
        if number is None:
            return "never"
        if key == "steps_to_finish":
            return _thousands(float(f"{number:.3g}"))
        plain = f"{number:.{decimals}f}"
        return plain.replace("0.", ".", 1) if plain.startswith(("0.", "-0.")) else plain

    point, low, high = map(text, numbers)
    return point if point == low == high == "never" else f"{point} [{low}, {high}]"
