"""Learning curves of a run as one PNG, in the manner of the paper's figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from srl_jax.report import panels, style
from srl_jax.report.data import Group, RunData
from srl_jax.report.style import STYLE, Looks
from srl_jax.statistics import iqm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMED = 8  # curves that a reader can tell apart


def save_curves(run: RunData, path: str | Path) -> None:
    """Draws interquartile means with 95 % bands against environment steps.

    Two large panels pool seeds and damages (success and return for `p2p`, return and distance otherwise), with the
    frozen behaviour policy dashed and the mean of the lanes' thresholds, `finish`, dotted. One small panel per damage
    follows where there are several. Below the steps stands robot time at 20 Hz. Of more than 8 methods those 8 that
    end highest in the first panel have names; the others are grey there and left out of the small panels.

    Args:
        run: from `report.data.read_metrics`.
        path: the PNG to write.

    Raises:
        ValueError: the run has neither of the two metrics, or its lanes do not fill seeds x damages.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    metrics = shown(run)
    if not metrics:
        raise ValueError(f"Nothing to draw: the run of task '{run.task}' has no eval/return and the like.")
    damages = list(dict.fromkeys(lane["damage"] for lane in run.lanes))
    columns = 7 if len(damages) > 12 else min(len(damages), 6)
    rows = math.ceil(len(damages) / columns) if len(damages) > 1 else 0
    looks = style.looks(run.groups, highest([run], metrics[0]))
    with rc_context(STYLE):
        figure = Figure(
            figsize=(11.5, 5.0 + 2.1 * rows), dpi=150, layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08)
        )
        heights = (5.0, 2.1 * rows) if rows else (1.0,)
        parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, metric in zip(parts[0].subplots(1, len(metrics), squeeze=False)[0], metrics, strict=True):
            panels.large(axes, run, metric, looks)
        if rows:
            panels.small(parts[1], run, metrics[0], damages, (rows, columns), looks)
        pooled = f"{_counted(len({lane['seed'] for lane in run.lanes}), 'seed')} × {_counted(len(damages), 'damage')}"
        title = f"Task {run.task}: interquartile mean of {pooled}, 95 % bootstrap band"
        _legend(figure, looks, title)
        style.save(figure, path)


def shown(run: RunData) -> list[str]:
    """The metrics of the large panels that the run has; the first is that of the small ones."""
    metrics = ("eval/success", "eval/return") if run.task == "p2p" else ("eval/return", "eval/distance")
    return [metric for metric in metrics if metric in run.metrics]


def save_panels(runs: Sequence[RunData], metric: str, path: str | Path) -> None:
    """Draws one large panel per run, side by side, as in the paper's figure.

    Args:
        runs: from `report.data.read_metrics`, typically one per task.
        metric: such as ``eval/return``.
        path: the PNG to write.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    groups = dict.fromkeys(group for run in runs for group in run.groups)
    looks = style.looks(groups, highest(runs, metric))
    with rc_context(STYLE):
        figure = Figure(figsize=(5.2 * len(runs), 4.4), dpi=150, layout="constrained")
        for axes, run in zip(figure.subplots(1, len(runs), squeeze=False)[0], runs, strict=True):
            own = {group: look for group, look in looks.items() if group in run.groups}
            panels.large(axes, run, metric, own, title=f"{run.task}: {panels.LABELS[metric]}")
        _legend(figure, looks)
        style.save(figure, path)


def highest(runs: Sequence[RunData], metric: str) -> list[Group]:
    """The methods that get a name: all, or of more than 8 those that end highest in any of the runs."""
    ends: dict[Group, float] = {}
    for run in runs:
        for group in run.groups:
            series = run.scores(metric, group)
            end = -math.inf if series is None else iqm(series.values[-1])
            ends[group] = max(end, ends.get(group, -math.inf))
    return sorted(ends, key=ends.__getitem__, reverse=True)[:NAMED]


def _legend(figure: Figure, looks: Looks, title: str = "") -> None:
    from matplotlib.lines import Line2D

    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if unnamed := sum("label" not in look for look in looks.values()):
        found[f"{unnamed} that end lower"] = Line2D([], [], color=style.OTHERS, linewidth=1.0)
    # Long names, as those of a sweep, stand in fewer columns: about 11 letters go into an inch.
    across = int(11 * figure.get_figwidth()) // (max(map(len, found), default=0) + 8)
    columns = max(min(len(found), across, 6), 1)
    legend = figure.legend(
        list(found.values()),
        list(found),
        loc="outside upper left",
        ncols=columns,
        fontsize=11 if len(found) <= 6 else 9.5,
        columnspacing=2.5,
    )
    figure.set_figheight(figure.get_figheight() + 0.22 * (math.ceil(len(found) / columns) - 1))
    legend.set_title(title)
    legend.set_alignment("left")


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
