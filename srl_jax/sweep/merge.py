"""One directory of a sweep, as if one run had made it: lanes, metrics, summary, curves, and what a swept value does.

Files are copied as streams and written anew by every merge, into a folder that then takes the place of the last one.
"""

import csv
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from itertools import accumulate
from pathlib import Path
from typing import Any

from srl_jax.job import page
from srl_jax.job.files import read_parts, write_json
from srl_jax.job.progress import together
from srl_jax.job.tables import join_metrics
from srl_jax.report import sensitivity
from srl_jax.report.complete import complete
from srl_jax.report.curves import save_curves
from srl_jax.report.data import RunData, read_metrics
from srl_jax.report.files import Lane, read_lanes
from srl_jax.report.summary import summarise
from srl_jax.sweep import attempts, lease
from srl_jax.sweep.manifest import Point, Sweep

SHOWN = 20  # packs or lanes that a list of missing ones names


def merge(sweep: Sweep) -> dict[str, Any]:
    """Writes `merged/` from the packs that are done; returns its summary.

    Its ``sweep`` says how many packs there are and which are missing, with their state and error; ``complete`` is
    whether none is missing and no lane has failed.

    Raises:
        ValueError: no pack is done.
        lease.HeldError: another merge is under way.
    """
    missing = set(sweep.unfinished())
    done = [number for number in range(len(sweep)) if number not in missing]
    if not done:
        raise ValueError(f"{sweep.directory} has nothing to merge yet: none of its {len(sweep)} packs is done.")
    target, fresh = sweep.directory / "merged", sweep.directory / "merged.partial"
    with lease.held(sweep.directory / "merge.lease", beat=5.0, patience=60.0):
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir()
        copy(sweep, done, fresh)
        summary = describe(sweep, done, fresh)
        write_json(fresh / "summary.json", summary)
        if failed := page.leave(fresh):
            summary["sweep"]["left_out"].append(failed)
        shutil.rmtree(target, ignore_errors=True)
        fresh.rename(target)
    return summary


def copy(sweep: Sweep, done: Sequence[int], into: Path) -> None:
    """lanes.csv, metrics.csv and config.json of all lanes of the packs that are done, one line at a time."""
    starts = [0, *accumulate(sum(point.lanes.values()) for point in sweep.points)]
    parts = [(sweep.pack(number).directory, sweep.point_of(number)) for number in done]
    with (into / "lanes.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(Lane.__annotations__))
        table.writeheader()
        for folder, place in parts:
            table.writerows(renamed(lane, sweep.points[place], starts[place]) for lane in read_lanes(folder))
    join_metrics([(folder, starts[place]) for folder, place in parts], into)
    stored = {"config": asdict(sweep.points[0].config), "parts": [x for folder, _ in parts for x in read_parts(folder)]}
    write_json(into / "config.json", stored)


def renamed(lane: Lane, point: Point, first: int) -> Lane:
    """A lane as it is called among those of all points: numbered on, the grid's settings in its variant."""
    variant = " ".join(filter(None, (point.label, lane["variant"])))
    return {**lane, "lane": lane["lane"] + first, "variant": variant}


def describe(sweep: Sweep, done: Sequence[int], folder: Path) -> dict[str, Any]:
    """The summary of what was merged; draws the curves, and a figure of what was swept."""
    whole = read_metrics(folder)
    run, left_out = complete(whole)
    missing = [sweep.pack(number) for number in sweep.unfinished()]
    summaries = [json.loads((sweep.pack(number).directory / "summary.json").read_text()) for number in done]
    about: dict[str, Any] = {
        "packs": len(sweep),
        "merged": len(done),
        "missing": [{"pack": pack.number, **asdict(attempts.fate(pack))} for pack in missing[:SHOWN]],
        "left_out": left_out,
    }
    machine = together([summary["machine"] for summary in summaries])
    if not run.lanes:
        nothing = {"task": whole.task, "methods": {}, "nonfinite_lanes": []}
        return nothing | {"machine": machine, "sweep": about | {"complete": False}}
    summary = summarise(run)
    about["complete"] = not missing and not summary["nonfinite_lanes"]
    save_curves(run, folder / "curves.png")
    _sensitivity(run, folder, about)
    return summary | {"machine": machine, "sweep": about}


def _sensitivity(run: RunData, folder: Path, about: dict[str, Any]) -> None:
    found = sensitivity.entries(run)
    if found:
        about["sensitivity"] = [entry._asdict() for entry in found]
        label = "area under success" if run.task == "p2p" else "area under return"
        sensitivity.save_figure(found, folder / "sensitivity.png", label)
