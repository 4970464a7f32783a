"""A run as data: its lanes, its metrics and its settings, and what a failed evaluation is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from srl_jax.report.files import Lane, Recorded, episodes, read_lanes, read_recorded, read_settings
from srl_jax.statistics import FloatArray

FINISH_FRACTION = 0.9
FAILED = {"success": 0.0, "fell": 1.0, "distance": 0.0}  # what an evaluation in which a lane exploded is worth


class Group(NamedTuple):
    """A method: the lanes that differ by seed and damage only."""

    algo: str
    variant: str

    @property
    def label(self) -> str:
        return f"{self.algo} {self.variant}".strip()


class Series(NamedTuple):
    """One metric of one method over a run."""

    steps: FloatArray  # [T] environment steps per lane
    values: FloatArray  # [T, seeds, conditions]
    seeds: list[int]
    conditions: list[str]


@dataclass(frozen=True)
class RunData:
    """One task of a run: its lanes, its metrics and its settings (the `config` of config.json)."""

    task: str
    lanes: list[Lane]
    metrics: Mapping[str, Recorded]
    config: Mapping[str, Any]

    @cached_property
    def groups(self) -> dict[Group, list[Lane]]:
        """The lanes of each method, in the order of `lanes.csv`."""
        groups: dict[Group, list[Lane]] = {}
        for lane in self.lanes:
            groups.setdefault(Group(lane["algo"], lane["variant"]), []).append(lane)
        return groups

    @cached_property
    def columns(self) -> dict[int, int]:
        """Where each lane stands in the arrays of metrics."""
        return {lane["lane"]: column for column, lane in enumerate(self.lanes)}

    def damages(self, group: Group) -> list[str]:
        """The conditions of a method, in the order of `lanes.csv`."""
        return list(dict.fromkeys(lane["damage"] for lane in self.groups.get(group, [])))

    @cached_property
    def episodes(self) -> int:
        """Episodes of an evaluation; runs older than `evaluation.episodes` had one per training environment."""
        return episodes(self.config)

    @cached_property
    def thresholds(self) -> FloatArray:
        """0.9 of each lane's own healthy return f64[L], which counts as solved; NaN where it earned nothing."""
        healthy = self.first("healthy/return")
        return FINISH_FRACTION * np.where(healthy > 0.0, healthy, np.nan)

    @property
    def finish(self) -> float | None:
        """Mean threshold of all lanes, for display only: every lane is judged by its own. None if no lane has one."""
        found = self.thresholds[np.isfinite(self.thresholds)]
        return float(found.mean()) if found.size else None

    def first(self, metric: str) -> FloatArray:
        """A metric of every lane at its first step, f64[L]; NaN where there is none."""
        rows = self.metrics.get(metric)
        return rows.values[0] if rows is not None else np.full(len(self.lanes), np.nan)

    def mean(self, metric: str) -> float | None:
        """Mean of `first` over all lanes, for display only; None if no lane has a finite value."""
        found = self.first(metric)[np.isfinite(self.first(metric))]
        return float(found.mean()) if found.size else None

    def last(self, metric: str) -> dict[int, float]:
        """A metric of every lane at the last step at which any has one: lane -> value, NaN where it was non-finite."""
        rows = self.metrics.get(metric)
        return {} if rows is None else {i: float(rows.values[-1, c]) for i, c in self.columns.items()}

    def grid(self, group: Group) -> NDArray[np.int64]:
        """The columns of a method's lanes, i64[seeds, conditions], by rising seed and in the order of `damages`.

        Raises:
            ValueError: its lanes do not fill seeds x damages exactly once.
        """
        lanes, conditions = self.groups.get(group, []), self.damages(group)
        seeds = sorted({lane["seed"] for lane in lanes})
        places = {(lane["seed"], lane["damage"]): self.columns[lane["lane"]] for lane in lanes}
        if not len(places) == len(lanes) == len(seeds) * len(conditions):
            raise ValueError(f"The {len(lanes)} lanes of '{group.label}' do not fill its seeds x damages once each.")
        return np.array([[places[s, c] for c in conditions] for s in seeds], np.int64)

    def series(self, metric: str, algo: str, variant: str = "") -> Series:
        """One metric of one method, every lane apart; NaN where a lane was non-finite.

        A last step at which some lane has no row yet (a run that was cut off) is left out.

        Raises:
            ValueError: no rows, a lane misses one, or lanes do not fill seeds x damages exactly once.
        """
        group = Group(algo, variant)
        grid, rows = self.grid(group), self.metrics.get(metric)
        if not grid.size or rows is None or not rows.written[:, grid].any():
            raise ValueError(f"'{group.label}' has no rows of '{metric}' for any lane.")
        kept = np.flatnonzero(rows.written[:, grid].any(axis=(1, 2)))
        if len(kept) > 1 and not rows.written[kept[-1]][grid].all():
            kept = kept[:-1]
        missing = np.argwhere(~rows.written[kept][:, grid])
        if missing.size:
            first, *place = missing[0]
            lane, step = self.lanes[grid[tuple(place)]]["lane"], rows.steps[kept[first]]
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise ValueError(f"'{group.label}' has no rows of '{metric}' for lane {lane} at step {step}{more}.")
        seeds = sorted({lane["seed"] for lane in self.groups[group]})
        return Series(rows.steps[kept].astype(float), rows.values[kept][:, grid], seeds, self.damages(group))

    def scores(self, metric: str, group: Group) -> Series | None:
        """`series` with what a failed evaluation is worth in place of NaN; None if the method has no such rows.

        Failed means that the lane exploded: no success, a fall, no distance, and of a return the lane's own worst, 0 at
        most. Dropping it would flatter what diverged, and no other lane may decide what it is worth.
        """
        rows = self.metrics.get(metric)
        if rows is None or not rows.written[:, self.grid(group)].any():
            return None
        series, name = self.series(metric, *group), metric.partition("/")[2]
        values = series.values
        finite = np.isfinite(values)
        worth = FAILED[name] if name in FAILED else np.where(finite, values, 0.0).min(axis=0).clip(max=0.0)
        return series._replace(values=np.where(finite, values, worth))


def read_metrics(directory: str | Path, task: str | None = None) -> RunData:
    """Reads `lanes.csv`, `metrics.csv` and `config.json` of a run.

    A repeated (step, lane, metric) keeps its last value, as a resumed run writes it; a half-written last line
    is dropped. `task` may be None where the run has one task only.

    Raises:
        ValueError: a file is missing or lacks a column, or the task is absent or has to be named.
    """
    directory = Path(directory)
    lanes = read_lanes(directory)
    tasks = list(dict.fromkeys(lane["task"] for lane in lanes))
    chosen = tasks[0] if task is None and len(tasks) == 1 else task
    if chosen not in tasks:
        raise ValueError(f"task is {task!r}; this run holds {', '.join(tasks) or 'no lanes'}: name one.")
    lanes = [lane for lane in lanes if lane["task"] == chosen]
    return RunData(chosen, lanes, read_recorded(directory / "metrics.csv", lanes), read_settings(directory))
