"""Reads the directory of a run and derives its summary; `plot` makes the table and the curves of it.

A lane that went non-finite counts as failed, never as absent: its missing values become the worst that any
lane of the run showed in that metric, and the summary lists it. Dropping it would flatter what diverged.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np

from srl_jax import statistics
from srl_jax.report.curves import format_table as format_table
from srl_jax.report.curves import save_curves as save_curves
from srl_jax.statistics import FloatArray

FINISH_FRACTION = 0.9
EVALUATED = ("eval/", "teacher/", "healthy/")
Scores = dict[str, FloatArray]  # entry of the summary -> one number per lane, [seeds, conditions]


class Lane(TypedDict):
    """One row of `lanes.csv`."""

    lane: int
    algo: str
    seed: int
    task: str
    damage: str
    variant: str


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
    """One task of a run: its lanes, its metrics as metric -> step -> lane -> value, and its configuration."""

    task: str
    lanes: list[Lane]
    metrics: Mapping[str, Mapping[int, Mapping[int, float]]]
    config: Mapping[str, Any]

    @property
    def groups(self) -> dict[Group, list[Lane]]:
        """The lanes of each method, in the order of `lanes.csv`."""
        groups: dict[Group, list[Lane]] = {}
        for lane in self.lanes:
            groups.setdefault(Group(lane["algo"], lane["variant"]), []).append(lane)
        return groups

    def damages(self, group: Group) -> list[str]:
        """The conditions of a method, in the order of `lanes.csv`."""
        return list(dict.fromkeys(lane["damage"] for lane in self.groups.get(group, [])))

    @property
    def finish(self) -> float | None:
        """0.9 of the healthy behaviour policy's mean return, which counts as solved; None if it earned nothing."""
        healthy = self.mean("healthy/return")
        return FINISH_FRACTION * healthy if healthy is not None and healthy > 0.0 else None

    def mean(self, metric: str) -> float | None:
        """Mean of a metric's finite values over all lanes at its first step; None if there is none."""
        rows = self.metrics.get(metric)
        finite = [value for value in rows[min(rows)].values() if math.isfinite(value)] if rows else None
        return float(np.mean(finite)) if finite else None

    def series(self, metric: str, algo: str, variant: str = "") -> Series:
        """One metric of one method, every lane apart; NaN where a lane was non-finite.

        A last step at which some lane has no row yet (a run that was cut off) is left out.

        Raises:
            ValueError: no rows, a lane misses one, or lanes do not fill seeds x damages exactly once.
        """
        lanes = self.groups.get(Group(algo, variant), [])
        name, rows = Group(algo, variant).label, self.metrics.get(metric, {})
        seeds = sorted({lane["seed"] for lane in lanes})
        conditions = self.damages(Group(algo, variant))
        grid = {(lane["seed"], lane["damage"]): lane["lane"] for lane in lanes}
        if not len(grid) == len(lanes) == len(seeds) * len(conditions):
            raise ValueError(f"The {len(lanes)} lanes of '{name}' do not fill its seeds x damages once each.")
        ids = set(grid.values())
        steps = sorted(step for step, row in rows.items() if ids & row.keys())
        if len(steps) > 1 and not ids <= rows[steps[-1]].keys():
            steps.pop()
        absent = [f"lane {lane} at step {step}" for step in steps for lane in sorted(ids - rows[step].keys())]
        if absent or not steps:
            raise ValueError(f"'{name}' has no rows of '{metric}' for {', '.join(absent) or 'any lane'}.")
        values = [[[rows[step][grid[s, c]] for c in conditions] for s in seeds] for step in steps]
        return Series(np.asarray(steps, np.float64), np.asarray(values, np.float64), seeds, conditions)

    def scores(self, metric: str, group: Group) -> Series | None:
        """`series` with non-finite values as the worst of the run; None if the method has no such rows."""
        rows, ids = self.metrics.get(metric, {}), {lane["lane"] for lane in self.groups[group]}
        seen = [value for row in rows.values() for value in row.values() if math.isfinite(value)]
        if not seen or not any(ids & row.keys() for row in rows.values()):
            return None
        series = self.series(metric, *group)
        worst = max(seen) if metric.endswith("/fell") else min(seen)
        return series._replace(values=np.where(np.isfinite(series.values), series.values, worst))


def read_metrics(directory: str | Path, task: str | None = None) -> RunData:
    """Reads `lanes.csv`, `metrics.csv` and `config.json` of a run.

    A repeated (step, lane, metric) keeps its last value, as a resumed run writes it; a half-written last line
    is dropped. `task` may be None where the run has one task only.

    Raises:
        ValueError: a file is missing or lacks a column, or the task is absent or has to be named.
    """
    directory = Path(directory)
    for name in ("lanes.csv", "metrics.csv", "config.json"):
        if not (directory / name).is_file():
            raise ValueError(f"{directory} is not the directory of a run: it has no {name}.")
    rows = _rows(directory / "lanes.csv", *Lane.__annotations__)
    lanes = [Lane(lane=int(i), algo=a, seed=int(s), task=t, damage=d, variant=v) for i, a, s, t, d, v in rows]
    tasks = list(dict.fromkeys(lane["task"] for lane in lanes))
    chosen = tasks[0] if task is None and len(tasks) == 1 else task
    if chosen not in tasks:
        raise ValueError(f"task is {task!r}; this run holds {', '.join(tasks) or 'no lanes'}: name one.")
    ids = {lane["lane"] for lane in lanes if lane["task"] == chosen}
    metrics: dict[str, dict[int, dict[int, float]]] = {}
    for step, lane, metric, value in _rows(directory / "metrics.csv", "step", "lane", "metric", "value"):
        if int(lane) in ids:
            metrics.setdefault(metric, {}).setdefault(int(step), {})[int(lane)] = float(value)
    config = json.loads((directory / "config.json").read_text())
    return RunData(chosen, [lane for lane in lanes if lane["lane"] in ids], metrics, config)


def _rows(path: Path, *columns: str) -> Iterator[list[str]]:
    with path.open(newline="") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))
        header = next(reader, [])
        if absent := [column for column in columns if column not in header]:
            raise ValueError(f"{path.name} lacks column {', '.join(absent)}; it has {', '.join(header)}.")
        places = [header.index(column) for column in columns]
        yield from ([row[place] for place in places] for row in reader)


def summarise(run: RunData, resamples: int = 2000) -> dict[str, Any]:
    """Summary of one task of a run, safe for JSON: inf and NaN are None, and what was not recorded is absent.

    Each method has `overall` and `conditions[damage]` with `{iqm, low, high}` (95 %) of `return`, `success`,
    `distance` (m), `fell` (mean of the last two evaluations), `area_success`, `area_return` (mean height),
    `retained` (distance over the mean healthy one), `retained_own` (over the lane's own), `teacher_*`,
    `healthy_*` (pi_B alone), `steps_to_finish` (None if over a quarter never do), and `{mean, low, high}` of
    `reached_finish` (fraction of lanes). `improvement`: P(x above y) of an area, over damages both have.

    Raises:
        ValueError: lanes do not fill seeds x damages, or rows are missing.
    """
    scores = {group: _lane_scores(run, group) for group in run.groups}
    evaluated = [max(rows) for metric, rows in run.metrics.items() if metric.startswith("eval/")]
    return {
        "task": run.task,
        "steps": max(evaluated, default=0),
        "finish": run.finish,
        "healthy": {name: run.mean(f"healthy/{name}") for name in ("return", "success", "distance")},
        "nonfinite_lanes": _nonfinite(run),
        "methods": {
            group.label: {
                **group._asdict(),
                "seeds": sorted({lane["seed"] for lane in run.groups[group]}),
                "overall": {name: _interval(name, x, resamples) for name, x in found.items()},
                "conditions": {
                    damage: {name: _interval(name, x[:, [c]], resamples) for name, x in found.items()}
                    for c, damage in enumerate(run.damages(group))
                },
            }
            for group, found in scores.items()
        },
        "improvement": _improvement(run, scores, resamples),
    }


def _lane_scores(run: RunData, group: Group) -> Scores:
    names = [name for name in run.metrics if name.startswith(EVALUATED)]
    read = {name: series for name in names if (series := run.scores(name, group)) is not None}
    found: Scores = {}
    for name, series in read.items():
        found[name.removeprefix("eval/").replace("/", "_")] = series.values[-2:].mean(axis=0)
    for name in ("success", "return"):
        if series := read.get(f"eval/{name}"):
            found[f"area_{name}"] = statistics.area_under_curve(series.steps, series.values)
    references = {"retained": run.mean("healthy/distance"), "retained_own": found.get("healthy_distance")}
    for name, healthy in references.items():
        if "distance" in found and healthy is not None and np.all(np.asarray(healthy) > 0):
            found[name] = found["distance"] / healthy
    if (series := read.get("eval/return")) and run.finish is not None:
        steps = statistics.steps_to_threshold(series.steps, series.values, run.finish)
        found |= {"steps_to_finish": steps, "reached_finish": np.isfinite(steps).astype(np.float64)}
    return found


def _interval(name: str, scores: FloatArray, resamples: int) -> dict[str, float | None]:
    kind, statistic = ("mean", np.mean) if name == "reached_finish" else ("iqm", statistics.iqm)
    ends = statistics.stratified_interval(scores, statistic, resamples=resamples)
    numbers = {kind: float(statistic(scores)), **ends._asdict()}
    return {key: value if math.isfinite(value) else None for key, value in numbers.items()}


def _nonfinite(run: RunData) -> list[dict[str, Any]]:
    first: dict[int, int] = {}
    tables = (rows.items() for metric, rows in run.metrics.items() if metric.startswith(EVALUATED))
    for step, row in itertools.chain.from_iterable(tables):
        first |= {i: min(step, first.get(i, step)) for i, x in row.items() if not math.isfinite(x)}
    return [{**lane, "step": first[lane["lane"]]} for lane in run.lanes if lane["lane"] in first]


def _improvement(run: RunData, scores: dict[Group, Scores], resamples: int) -> list[dict[str, Any]]:
    found = []
    for (x, y), name in itertools.product(itertools.permutations(scores, 2), ("area_success", "area_return")):
        first, second = run.damages(x), run.damages(y)
        shared = [damage for damage in first if damage in second]
        if shared and name in scores[x] and name in scores[y]:
            left = scores[x][name][:, [first.index(damage) for damage in shared]]
            right = scores[y][name][:, [second.index(damage) for damage in shared]]
            p, low, high = statistics.probability_of_improvement(left, right, resamples=resamples)
            pair = {"x": x.label, "y": y.label, "score": name}
            found.append({**pair, "probability": p, "low": low, "high": high})
    return found
