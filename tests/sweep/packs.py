"""Sweeps whose packs are done, without training: their files hold made-up numbers."""

import dataclasses
import json
from pathlib import Path

from srl_jax.config import preset
from srl_jax.job import files, plan, tables
from srl_jax.sweep import attempts, manifest
from srl_jax.sweep.manifest import Point, Sweep

BASE = dataclasses.replace(preset("smoke"), seeds="3", damage="leg_rm,leg_lf")
MACHINE = {"lanes": 1, "training_seconds": 2.0, "compile_seconds": 3.0, "peak_memory_gib": 1.5}


def planned(directory: Path, pack_lanes: int = 4, grid=(("", {}),), **changes) -> Sweep:
    """A sweep with a manifest, of which nothing is done."""
    points = []
    for label, own in grid:
        points.append(Point(label, (), dataclasses.replace(BASE, **changes, **own)))
    sweep = Sweep(directory, manifest.split(points, pack_lanes))
    manifest.write(sweep)
    return sweep


def value(lane, step: int, point: int = 0) -> float:
    """What a lane is said to have measured: another number for each."""
    return lane.index + step / 1000 + 1000.0 * point


def finish(sweep: Sweep, number: int, *, broken: bool = False) -> None:
    """Leaves the files of a pack that has been trained; a broken one has a lane that was not finite."""
    pack, point = sweep.pack(number), sweep.point_of(number)
    pack.directory.mkdir(parents=True)
    attempts.begin(pack.task)
    lanes = plan.make(pack.config).lanes
    files.write_config(pack.directory, pack.config, 1)
    tables.write_lanes(pack.directory, lanes)
    metrics = tables.Metrics(pack.directory)
    metrics.write([(0, lane.index, "healthy/return", 10.0) for lane in lanes])
    for step in (0, 800, 1600):
        for name in ("return", "success", "distance"):
            rows = [(step, lane.index, f"eval/{name}", value(lane, step, point)) for lane in lanes]
            if broken and step == 1600:
                rows[0] = (step, lanes[0].index, f"eval/{name}", float("nan"))
            metrics.write(rows)
    machine = MACHINE | {"lanes": len(lanes)}
    first = lanes[0]
    lost = {"lane": first.index, "algo": first.algo, "variant": "", "seed": first.seed, "damage": first.damage}
    summary = {"machine": machine, "nonfinite_lanes": [{**lost, "step": 1600}] if broken else []}
    (pack.directory / "summary.json").write_text(json.dumps(summary))
    attempts.end(pack.task, 0)
