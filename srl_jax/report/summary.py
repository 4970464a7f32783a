"""Derives the summary of a run: every lane's scores, then interquartile means over the lanes of a method.

A method's entries come from its own lanes alone: what ran beside it moves none of its numbers.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from srl_jax import statistics
from srl_jax.report.data import Group, RunData
from srl_jax.statistics import FloatArray

MEASURED = ("eval/", "teacher/", "healthy/", "reference/")
ALL_PAIRS = 12  # methods, up to which each is compared with each
Scores = dict[str, FloatArray]  # entry of the summary -> one number per lane, [seeds, conditions]


def summarise(run: RunData, resamples: int = 2000) -> dict[str, Any]:
    """Summary of one task of a run, safe for JSON: inf and NaN are None, and what was not recorded is absent.

    Each method has `overall` and `conditions[damage]` with `{iqm, low, high}` (95 %) of the entries of `lane_scores`
    (`{mean, low, high}` of `reached_finish`, the fraction of lanes); None in `steps_to_finish` means that over a
    quarter never do. `finish`, `healthy` and `reference` are means over all lanes, for display: no lane is judged by
    them. `improvement`: P(x above y) of an area, over damages that both have; with more than 12 methods, for pairs with
    the first one only, and `improvement_note` says so. `nonfinite_lanes` lists each lane of which an evaluation
    exploded, with the first such step and what was measured there.

    Raises:
        ValueError: lanes do not fill seeds x damages, or rows are missing.
    """
    scores = {group: lane_scores(run, group) for group in run.groups}
    evaluated = [int(rows.steps[-1]) for metric, rows in run.metrics.items() if metric.startswith("eval/")]
    names = ("return", "success", "distance")
    summary = {
        "task": run.task,
        "steps": max(evaluated, default=0),
        "finish": run.finish,
        "healthy": {name: run.mean(f"healthy/{name}") for name in names},
        "reference": {name: run.mean(f"reference/{name}") for name in names},
        "nonfinite_lanes": _nonfinite(run),
        "methods": {group.label: _method(run, group, found, resamples) for group, found in scores.items()},
        "improvement": _improvement(run, scores, resamples),
    }
    if len(scores) > ALL_PAIRS:
        first = next(iter(scores)).label
        summary["improvement_note"] = f"{len(scores)} methods: only pairs with the first, '{first}', were compared."
    return summary


def lane_scores(run: RunData, group: Group) -> Scores:
    """The scores of a method's lanes, each [seeds, conditions]; an entry that was not recorded is absent.

    - `return`, `success`, `distance` (m), `fell`: mean of the last two evaluations;
    - `area_success`, `area_return`: mean height of the learning curve;
    - `teacher_*` (pi_B alone, under the damage at the end), `healthy_*`, `reference_*` (at the first step);
    - `gauge_*`: the last total that a lane has shown, absent where some lane shows none;
    - `retained`: distance over the lane's own `reference/distance`, that of one gait for all methods; in runs that
      are older than this reference over `healthy/distance`. `retained_own`: over `healthy/distance`, the distance of
      its own pi_B. NaN where the healthy distance is not above 0;
    - `steps_to_finish`, `reached_finish`: against 0.9 of the lane's own healthy return. A lane that earned nothing
      healthy has no threshold and never reaches it; both are absent where no lane has one.
    """
    found: Scores = {}
    curves = {}
    for name in run.metrics:
        prefix, _, short = name.partition("/")
        if prefix == "gauge":
            found |= _gauge(run, name, group)
        elif name.startswith(MEASURED) and (series := run.scores(name, group)) is not None:
            if prefix == "eval":
                curves[short], found[short] = series, series.values[-2:].mean(axis=0)
            else:
                found[f"{prefix}_{short}"] = series.values[-1 if prefix == "teacher" else 0]
    for name in ("success", "return"):
        if name in curves:
            found[f"area_{name}"] = statistics.area_under_curve(curves[name].steps, curves[name].values)
    common = "reference_distance" if "reference_distance" in found else "healthy_distance"
    for name, healthy in (("retained", common), ("retained_own", "healthy_distance")):
        if "distance" in found and healthy in found:
            found[name] = found["distance"] / np.where(found[healthy] > 0.0, found[healthy], np.nan)
    thresholds = run.thresholds[run.grid(group)]
    if "return" in curves and np.isfinite(thresholds).any():
        steps, values = curves["return"].steps, curves["return"].values
        reached = statistics.steps_to_threshold(steps, values, np.nan_to_num(thresholds, nan=np.inf))
        found |= {"steps_to_finish": reached, "reached_finish": np.isfinite(reached).astype(np.float64)}
    return found


def _gauge(run: RunData, metric: str, group: Group) -> Scores:
    # Totals only grow, so that the last one that a lane has shown also stands for steps at which it shows none.
    values = run.metrics[metric].values[:, run.grid(group)]
    finite = np.isfinite(values)
    if not finite.any(axis=0).all():
        return {}
    last = len(values) - 1 - finite[::-1].argmax(axis=0)
    return {metric.replace("/", "_"): np.take_along_axis(values, last[None], axis=0)[0]}


def _method(run: RunData, group: Group, found: Scores, resamples: int) -> dict[str, Any]:
    damages = run.damages(group)
    apart = _entries({name: x.T[:, :, None] for name, x in found.items()}, len(damages), resamples)
    return {
        **group._asdict(),
        "seeds": sorted({lane["seed"] for lane in run.groups[group]}),
        "overall": _entries({name: x[None] for name, x in found.items()}, 1, resamples)[0],
        "conditions": dict(zip(damages, apart, strict=True)),
    }


def _entries(tables: Scores, parts: int, resamples: int) -> list[dict[str, dict[str, float | None]]]:
    # Of name -> [parts, seeds, conditions] the entries of each part; those of one statistic are drawn at once.
    found: list[dict[str, dict[str, float | None]]] = [{} for _ in range(parts)]
    for kind, statistic in (("iqm", statistics.iqm), ("mean", np.mean)):
        chosen = [name for name in tables if (name == "reached_finish") == (kind == "mean")]
        places = [(k, name) for name in chosen for k in range(parts) if not np.isnan(tables[name][k]).any()]
        if places:
            values = np.stack([tables[name][k] for k, name in places])
            points = np.asarray(statistic(values.reshape(len(values), -1), axis=-1))
            ends = statistics.stratified_intervals(values, statistic, resamples=resamples)
            for (k, name), *numbers in zip(places, points.tolist(), *ends.T.tolist(), strict=True):
                finite = [number if math.isfinite(number) else None for number in numbers]
                found[k][name] = dict(zip((kind, "low", "high"), finite, strict=True))
    return found


def _nonfinite(run: RunData) -> list[dict[str, Any]]:
    first: dict[int, int] = {}
    where: dict[int, set[str]] = {}
    for metric, rows in run.metrics.items():
        if metric.startswith(MEASURED):
            failed = rows.written & ~np.isfinite(rows.values)
            for column in np.flatnonzero(failed.any(axis=0)).tolist():
                step = int(rows.steps[failed[:, column].argmax()])
                first[column] = min(step, first.get(column, step))
                where.setdefault(column, set()).add(metric.partition("/")[0])
    return [{**run.lanes[c], "step": first[c], "measured": sorted(where[c])} for c in sorted(first)]


def _improvement(run: RunData, scores: dict[Group, Scores], resamples: int) -> list[dict[str, Any]]:
    pairs = itertools.combinations(scores, 2)
    if len(scores) > ALL_PAIRS:
        pairs = itertools.islice(pairs, len(scores) - 1)  # those of the first method come first
    found = []
    for (x, y), name in itertools.product(pairs, ("area_success", "area_return")):
        first, second = run.damages(x), run.damages(y)
        shared = [damage for damage in first if damage in second]
        if shared and name in scores[x] and name in scores[y]:
            left = scores[x][name][:, [first.index(damage) for damage in shared]]
            right = scores[y][name][:, [second.index(damage) for damage in shared]]
            p, low, high = statistics.probability_of_improvement(left, right, resamples=resamples)
            pair = {"x": x.label, "y": y.label, "score": name, "probability": p, "low": low, "high": high}
            turned = {"x": y.label, "y": x.label, "probability": 1.0 - p, "low": 1.0 - high, "high": 1.0 - low}
            found += [pair, {**pair, **turned}]
    return found
