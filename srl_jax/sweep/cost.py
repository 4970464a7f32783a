"""What a sweep will cost, by arithmetic before anything is submitted: hours, memory, disk; and how large packs are.

The rates are those of one Zen 4 core; `experiments/sweep_simulation.py` has what follows for the size of packs from
failures and preemption.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax

from srl_jax.config import Config
from srl_jax.job import memory, plan
from srl_jax.sweep.manifest import Point, Sweep, split

LEARNING = 5.4e10  # operations per second and core that updates reach, as `memory.operations` counts them
ACTING = 9e-6  # s per environment step and core: acting, physics, evaluations
START = 60.0  # s of a task that are not training: imports, compiling, cloning, files
PACK_HOURS = 0.5  # of a pack, at most: longer ones leave nodes idle at the end, shorter ones start too often
LEAST = 8  # lanes a core, below which a core is not kept busy
EVALUATION = 2 * 30 * 32  # bytes of a lane's evaluation: some 30 rows of metrics.csv, in the pack and merged


class Speed(NamedTuple):
    """How fast one core is, as `job.speed` measures it on all of them."""

    sgemm: float  # operations per second
    physics: float  # steps per second


OF_RATES = Speed(98e9, 3.8e5)  # of the core that the rates are of; its physics took one Newton iteration


@dataclass(frozen=True)
class Cost:
    """Of a whole sweep; a pack's figures are the largest pack's."""

    lanes: int
    packs: int
    pack_lanes: int
    pack_seconds: float
    pack_bytes: int
    core_hours: float
    disk_bytes: int


def lane_seconds(config: Config, algo: str, speed: Speed = OF_RATES) -> float:
    """Core seconds of one lane, on such cores; one that multiplies large matrices faster learns no faster for that."""
    learning = memory.operations(config, {algo: 1}) / LEARNING * max(OF_RATES.sgemm / speed.sgemm, 1.0)
    return learning + config.steps * ACTING * (OF_RATES.physics / speed.physics)


def run_seconds(config: Config, cores: int, speed: Speed = OF_RATES) -> float | None:
    """Of a whole run on so many such cores; None on an accelerator, whose rates nobody knows beforehand."""
    if jax.default_backend() != "cpu":
        return None
    lanes = Counter(lane.algo for lane in plan.make(config).lanes)
    return START + sum(count * lane_seconds(config, algo, speed) for algo, count in lanes.items()) / cores


def seconds(point: Point, lanes: float, cpus: int) -> float:
    """Of a task with so many of a point's lanes."""
    total = sum(point.lanes.values())
    each = sum(lane_seconds(point.config, algo) * count for algo, count in point.lanes.items()) / total
    return START + lanes * each / cpus


def best_pack(points: Sequence[Point], cpus: int, limit_gb: float, at_once: int = 0) -> int:
    """Lanes of a pack: as many as take half an hour and fit the memory, but enough to keep every core busy.

    Where it is known how many packs run at once, they are no longer than the root of 2 x start x what is left of the
    whole sweep if nothing but training took time: then starts and idle nodes at the end together cost least.
    """
    sizes, longest = [], PACK_HOURS * 3600
    if at_once > 1:
        whole = sum((seconds(point, sum(point.lanes.values()), cpus) - START) / at_once for point in points)
        longest = min(longest, math.sqrt(2 * START * whole))
    for point in points:
        total = sum(point.lanes.values())
        per_lane = seconds(point, 1.0, cpus) - START
        wanted = max(LEAST * cpus, int((longest - START) / per_lane))
        least = -(-total // min(point.lanes.values()))  # every pack has a lane of each algorithm
        size = max(min(wanted, total), min(least, total))
        while size > least and sum(bytes_of(point, size, cpus)) > limit_gb * 2**30:
            size = max(least, size * 3 // 4)
        sizes.append(size)
    return min(sizes)


def bytes_of(point: Point, pack_lanes: int, cpus: int) -> memory.Bytes:
    """What a pack of so many lanes allocates."""
    parts = split([point], pack_lanes)[0].parts
    config = dataclasses.replace(point.config, part=f"1/{parts}")
    return memory.needed(config, plan.make(config).lanes, cpus)


def cost(sweep: Sweep, cpus: int) -> Cost:
    """The arithmetic of a planned sweep, every task on so many cores."""
    hours, longest, largest, pack_bytes, disk, lanes = 0.0, 0.0, 0, 0, 0, 0
    for point in sweep.points:
        total = sum(point.lanes.values())
        size = -(-total // point.parts)
        each = seconds(point, total / point.parts, cpus)
        hours += each * point.parts * cpus / 3600
        longest, largest, lanes = max(longest, each), max(largest, size), lanes + total
        needs = bytes_of(point, size, cpus)
        pack_bytes = max(pack_bytes, sum(needs))
        evaluations = point.config.steps // point.config.train.evaluate_every + 2
        disk += total * evaluations * EVALUATION + needs.checkpoint * point.parts
    return Cost(lanes, len(sweep), largest, longest, pack_bytes, hours, disk)


def lines(found: Cost, cpus: int, at_once: int) -> list[str]:
    """The arithmetic in words."""
    hours = -(-found.packs // at_once) * found.pack_seconds / 3600
    minutes, gib, plural = found.pack_seconds / 60, found.pack_bytes / 2**30, "s" if cpus > 1 else ""
    return [
        f"{found.lanes:,} lanes in {found.packs:,} packs of up to {found.pack_lanes:,}, each on {cpus} core{plural}: "
        f"{minutes:,.0f} min and {gib:.1f} GiB a pack",
        f"{found.core_hours:,.1f} core hours; with {at_once:,} packs at once {hours:,.1f} hours",
        f"{found.disk_bytes / 2**30:,.1f} GiB on disk, checkpoints included",
    ]
