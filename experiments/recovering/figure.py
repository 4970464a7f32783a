"""One panel a row: speed kept against the time since the damage, every method a line."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from srl_jax.report.style import PALETTE, STYLE

DASHED = ("oracle", "healthy", "uniform")


def save(path: Path, seconds: np.ndarray, curves: Mapping[str, Mapping[str, Sequence[float]]], said: Mapping[str, str]):
    """Writes a PNG.

    Args:
        path: of the file.
        seconds: f64[T] after the damage.
        curves: row -> method -> share of the healthy speed, T numbers.
        said: row -> what is written above its panel.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        width = min(len(curves), 2 if len(curves) in (2, 4) else 3)
        height = -(-len(curves) // width)
        figure = Figure(figsize=(4.2 * width, 3.1 * height + 0.5), layout="constrained")
        axes = figure.subplots(height, width, sharex=True, sharey=True, squeeze=False)
        for axis in axes.flat[len(curves) :]:
            axis.set_visible(False)
        methods = list(dict.fromkeys(method for row in curves.values() for method in row))
        for axis, (row, lines) in zip(axes.flat, curves.items(), strict=False):
            for method, shares in lines.items():
                look = "--" if method in DASHED else "-"
                colour = PALETTE[methods.index(method) % len(PALETTE)]
                axis.plot(seconds, shares, look, color=colour, label=method, linewidth=1.8)
            axis.axhline(1.0, color="#999999", linewidth=0.8)
            axis.set_title(said[row], fontsize=10)
            axis.set_xscale("log")
            axis.set_xticks([1, 2, 5, 10, 20, 40], ["1", "2", "5", "10", "20", "40"])
            axis.minorticks_off()
        for axis in axes[:, 0]:
            axis.set_ylabel("share of healthy speed")
        for axis in axes[-1]:
            axis.set_xlabel("seconds after the damage")
        handles = {
            label: line for axis in axes.flat for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(len(handles), 6))
        figure.savefig(path, dpi=130)
