"""The picture of a repertoire: every cell of the map, and how it filled."""

from pathlib import Path
from typing import Any

import numpy as np

from srl_jax.ite.elites import BINS, CELLS, Archive
from srl_jax.report.style import STYLE

SIDE = BINS**3


def nested(fitness: np.ndarray) -> np.ndarray:
    """The six dimensions as an image f[125, 125], NaN where empty.

    A row is the right legs' bins (front, middle, rear), a column the left legs'; the front leg is the coarsest.
    """
    return np.where(np.isfinite(fitness), fitness, np.nan).reshape(SIDE, SIDE)


def save_map(archive: Archive, history: np.ndarray, path: Path) -> None:
    """Draws the map, its filled cells and best fitness against evaluations, and its histogram of fitness.

    Args:
        archive: the map.
        history: f[generations, >= 4] evaluations, filled cells, best and mean fitness (m).
        path: the PNG to write.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    fitness = np.asarray(archive.fitness)
    found = fitness[np.isfinite(fitness)]
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(11.5, 6.4), dpi=150, layout="constrained")
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(6.4, 5.1))[0]
        _draw_map(left, fitness)
        coverage, speed, histogram = right.subplots(3, 1)
        for axes, columns, label in ((coverage, (1,), "filled cells"), (speed, (2, 3), "distance in 5 s (m)")):
            for column, name, color in zip(columns, ("best", "mean"), ("#0072B2", "#E69F00"), strict=False):
                axes.plot(history[:, 0], history[:, column], color=color, label=name)
            axes.set(ylabel=label, xlabel="evaluations", xlim=(0, None))
            axes.locator_params(axis="x", nbins=5)
        coverage.set_ylim(0, None)
        speed.legend(loc="lower right")
        coverage.set_title(f"{len(found):,} of {CELLS:,} cells ({len(found) / CELLS:.0%})", loc="left", fontsize=10)
        histogram.hist(found, bins=40, color="#0072B2")
        histogram.set(xlabel="distance in 5 s of a cell's gait (m)", ylabel="cells")
        partial = path.with_suffix(".partial")
        figure.savefig(partial, format="png")
    partial.replace(path)


def _draw_map(figure: Any, fitness: np.ndarray) -> None:
    axes = figure.subplots()
    axes.set_facecolor("#eeeeee")
    image = axes.imshow(nested(fitness), origin="lower", cmap="viridis", interpolation="nearest")
    edges = np.arange(0, SIDE + 1, BINS**2) - 0.5
    for edge in edges[1:-1]:
        axes.axhline(edge, color="white", lw=1.2)
        axes.axvline(edge, color="white", lw=1.2)
    names = [f"{low / BINS:.1f}–{(low + 1) / BINS:.1f}" for low in range(BINS)]
    axes.set_xticks(edges[:-1] + BINS**2 / 2, names)
    axes.set_yticks(edges[:-1] + BINS**2 / 2, names)
    axes.set_xlabel("duty factor of the left front leg (within a block: middle, rear)")
    axes.set_ylabel("duty factor of the right front leg (within a block: middle, rear)")
    figure.colorbar(image, ax=axes, label="distance in 5 s (m)", shrink=0.7, location="top", aspect=40)
