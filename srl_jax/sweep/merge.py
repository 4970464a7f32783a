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

from srl_jax.job import files
from srl_jax.report import sensitivity
from srl_jax.report.complete import complete
from srl_jax.report.curves import save_curves
from srl_jax.report.data import RunData, read_metrics
from srl_jax.report.files import METRICS_HEADER, Lane, read_lanes
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
    done = [pack.number for pack in sweep.packs() if (pack.directory / "summary.json").exists()]
    if not done:
        raise ValueError(f"{sweep.directory} has nothing to merge yet: none of its {len(sweep)} packs is done.")
    target, fresh = sweep.directory / "merged", sweep.directory / "merged.partial"
    with lease.held(sweep.directory / "merge.lease", beat=5.0, patience=60.0):
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir()
        copy(sweep, done, fresh)
        summary = describe(sweep, done, fresh)
        files.write_json(fresh / "summary.json", summary)
        shutil.rmtree(target, ignore_errors=True)
        fresh.rename(target)
    return summary


def copy(sweep: Sweep, done: Sequence[int], into: Path) -> None:
    """lanes.csv, metrics.csv and config.json of all lanes of the packs that are done, one line at a time."""
    starts = [0, *accumulate(sum(point.lanes.values()) for point in sweep.points)]
    wanted = set(done)
    with (into / "lanes.csv").open("w", newline="") as lanes, (into / "metrics.csv").open("w", newline="") as metrics:
        table = csv.DictWriter(lanes, list(Lane.__annotations__))
        table.writeheader()
        csv.writer(metrics).writerow(METRICS_HEADER)
        for place, point in enumerate(sweep.points):
            for number in sorted(wanted.intersection(sweep.of_point(place))):
                pack = sweep.pack(number).directory
                table.writerows(renamed(lane, point, starts[place]) for lane in read_lanes(pack))
                _copy_metrics(pack / "metrics.csv", metrics, starts[place])
    config = asdict(sweep.points[0].config)
    parts = [part for number in done for part in files.read_parts(sweep.pack(number).directory)]
    files.write_json(into / "config.json", {"config": config, "parts": parts})


def renamed(lane: Lane, point: Point, first: int) -> Lane:
    """A lane as it is called among those of all points: numbered on, the grid's settings in its variant."""
    variant = " ".join(filter(None, (point.label, lane["variant"])))
    return {**lane, "lane": lane["lane"] + first, "variant": variant}


def _copy_metrics(source: Path, into: Any, first: int) -> None:
    with source.open(newline="") as rows:
        next(rows)
        if not first:
            into.writelines(row for row in rows if row.endswith("\n"))
            return
        for row in rows:
            step, lane, rest = row.split(",", 2)
            into.write(f"{step},{int(lane) + first},{rest}")


def describe(sweep: Sweep, done: Sequence[int], folder: Path) -> dict[str, Any]:
    """The summary of what was merged; draws the curves, and a figure of what was swept."""
    whole = read_metrics(folder)
    run, left_out = complete(whole)
    missing = {
        number: attempts.fate(sweep.task_directory(number), sweep.pack(number).directory)
        for number in sorted(set(range(len(sweep))) - set(done))
    }
    about: dict[str, Any] = {
        "packs": len(sweep),
        "merged": len(done),
        "missing": [{"pack": number, **asdict(fate)} for number, fate in list(missing.items())[:SHOWN]],
        "left_out": left_out,
        "machine": together(
            [json.loads((sweep.pack(n).directory / "summary.json").read_text())["machine"] for n in done]
        ),
    }
    if not run.lanes:
        return {"task": whole.task, "methods": {}, "nonfinite_lanes": [], "sweep": about | {"complete": False}}
    summary = summarise(run)
    about["complete"] = not missing and not summary["nonfinite_lanes"]
    save_curves(run, folder / "curves.png")
    _sensitivity(run, folder, about)
    return summary | {"sweep": about}


def _sensitivity(run: RunData, folder: Path, about: dict[str, Any]) -> None:
    found = sensitivity.entries(run)
    if found:
        about["sensitivity"] = [entry._asdict() for entry in found]
        label = "area under success" if run.task == "p2p" else "area under return"
        sensitivity.save_figure(found, folder / "sensitivity.png", label)


def together(machines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What all packs took: lanes and seconds added, the highest peak of memory."""
    peaks = [machine["peak_memory_gib"] for machine in machines if machine.get("peak_memory_gib") is not None]
    sums = {
        name: sum(machine[name] for machine in machines) for name in ("lanes", "training_seconds", "compile_seconds")
    }
    return sums | {"peak_memory_gib": max(peaks, default=None)}
