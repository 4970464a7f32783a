"""How long packs should be and how often they should save: a sweep on a cluster that fails, simulated event by event.

    python -m experiments.sweep_simulation --nodes 1000 --lanes 1000000

A node takes a pack, starts, compiles (where nothing is cached, one node for all) and trains; it halts to save, and the
file system takes checkpoints in the order in which they come. A node that dies loses what was not saved; a task that is
preempted saves first. Waste is what is not kept training, of all nodes' time from the first start to the last end.
"""

import dataclasses
import heapq
import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax.cli.ending import leave

IDLE, START, TRAIN, SAVE, DOWN = range(5)  # what a node does; compiling belongs to the start
DONE = 1e-6  # s of training that may be missing, by rounding
NEAR = 1.0  # % of all time: packs that waste no more than that beyond the least are nearly as good
TITLES = ("lanes", "hours", "saved every s", "wall h", "waste %", "start", "saving", "lost", "idle", "restarts")
RATES = ("GB/s mean", "peak")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """The cluster, the work, and what is tried."""

    nodes: int = 1_000
    cores: int = 8
    """Of a node; all of them work on one pack."""
    lanes: int = 1_000_000
    steps: tuple[int, ...] = (50_000, 1_000_000)
    """Environment steps of a lane; a table each."""
    step_seconds: float = 215e-6
    """Core seconds of an environment step, learning included."""
    pack_lanes: tuple[int, ...] = (16, 32, 64, 136, 256, 512, 1_024, 2_680)
    """Lanes of a pack: 2,680 of 50,000 steps, or 136 of 1,000,000, take an hour on 8 cores."""
    intervals: tuple[float, ...] = (300.0, 900.0, 1_800.0, 3_600.0)
    """Seconds of training from one checkpoint of a pack to the next; inf: only at the end."""
    seeds: int = 3
    start: float = 25.0
    """Seconds of imports and cloning, in every attempt at a pack."""
    cold: float = 35.0
    """Seconds of compiling for the first pack; the others wait for it."""
    warm: float = 8.0  # s of compiling from the cache
    save_seconds: float = 1 / 120
    """Of a checkpoint, per lane, while nobody else writes."""
    lane_bytes: float = 9e6
    """Of a lane in a checkpoint, most of it replay."""
    metrics_bytes: float = 0.4
    """Of metrics per environment step."""
    bandwidth: float = 10.0
    """GB/s that the shared file system takes in; inf: any."""
    mtbf_hours: float = 720.0
    """Mean hours until a node dies; inf: never."""
    repair: float = 1_800.0  # s until it is back
    patience: float = 90.0
    """Seconds until its lease counts as given up."""
    requeue: float = 120.0
    """Further seconds until a pack that was cut off joins the end of the queue."""
    preempted: float = 0.05
    """Share of the running tasks that is preempted in a day."""
    speed_spread: float = 0.05
    """Standard deviation of the logarithm of nodes' speeds."""


@dataclasses.dataclass(slots=True)
class Node:
    """A machine and what it is at."""

    speed: float
    task: Iterator[tuple[int, float]]  # its phases to come, and the seconds of each
    pack: int = -1
    phase: int = IDLE
    since: float = 0.0
    turn: int = 0  # counts phases, so that nothing ends another than the one it was meant for
    trained: float = 0.0  # s since the pack was saved
    leaving: bool = False


def pack_seconds(asked: Arguments, steps: int, lanes: int) -> float:
    """Training of a pack; where its lanes do not divide by the cores, some cores wait."""
    return -(-lanes // asked.cores) * steps * asked.step_seconds


class Cluster:
    """A sweep of lanes of so many steps; `run` does it. Times are in seconds."""

    def __init__(self, asked: Arguments, steps: int, pack_lanes: int, interval: float, seed: int):
        self.asked, self.steps, self.interval, self.random = asked, steps, interval, np.random.default_rng(seed)
        self.unfinished = parts = -(-asked.lanes // pack_lanes)  # as equal as `sweep.manifest.split` makes them
        self.sizes = [asked.lanes // parts + (pack < asked.lanes % parts) for pack in range(parts)]
        self.left = [pack_seconds(asked, steps, size) for size in self.sizes]
        speeds = np.exp(asked.speed_spread * self.random.standard_normal(asked.nodes))
        self.nodes = [Node(speed, iter(())) for speed in speeds.tolist()]
        self.queue, self.free, self.events, self.made = deque(range(parts)), deque(self.nodes), [], 0
        self.spent, self.restarts, self.writing, self.most_writing = [0.0] * 5, 0, 0, 0  # spent: in each phase
        self.now = self.kept = self.lost = self.work = self.written = self.busy_until = 0.0
        # Misfortunes come to every node at one constant rate, so one clock serves all.
        preemption = 86_400 / asked.preempted if asked.preempted else math.inf
        for what, mean in ((self.fail, 3600 * asked.mtbf_hours), (self.preempt, preemption)):
            self.later(self.random.exponential(mean / asked.nodes), self.misfortune, what, mean / asked.nodes)
        self.dispatch()

    def run(self) -> "Cluster":
        while self.unfinished:
            self.now, _, action, arguments = heapq.heappop(self.events)
            action(*arguments)
        for node in self.nodes:
            self.spent[node.phase] += self.now - node.since
        return self

    def later(self, seconds: float, action: Callable[..., None], *arguments: Any) -> None:
        self.made += 1  # of two events at one time the one that was made first comes first
        heapq.heappush(self.events, (self.now + seconds, self.made, action, arguments))

    def misfortune(self, what: Callable[[Node], None], every: float) -> None:
        what(self.nodes[self.random.integers(len(self.nodes))])
        self.later(self.random.exponential(every), self.misfortune, what, every)

    def advance(self, node: Node, turn: int | None = None) -> None:
        if turn not in (None, node.turn):
            return
        passed, before = self.now - node.since, node.phase
        self.spent[before] += passed
        node.trained += passed if before == TRAIN else 0.0
        node.phase, seconds = next(node.task, (IDLE, math.inf))
        node.since, node.turn = self.now, node.turn + 1
        self.writing += (node.phase == SAVE) - (before == SAVE)
        self.most_writing = max(self.most_writing, self.writing)
        if node.phase == IDLE:
            self.free.append(node)
            self.dispatch()
        else:
            self.later(seconds, self.advance, node, node.turn)

    def dispatch(self, *packs: int) -> None:
        self.queue.extend(packs)
        while self.queue and self.free:
            node = self.free.popleft()
            if node.phase == IDLE:  # else it died while it was free
                node.task = self.attempt(node, self.queue.popleft())
                self.advance(node)

    def attempt(self, node: Node, pack: int) -> Iterator[tuple[int, float]]:
        asked, lanes, node.pack, node.leaving = self.asked, self.sizes[pack], pack, False
        waiting = max(asked.cold - self.now, 0.0)  # until the first has compiled
        yield START, asked.start + waiting + (asked.warm if self.now or pack else 0.0)
        while self.left[pack] > DONE and not node.leaving:
            yield TRAIN, min(self.interval, self.left[pack]) / node.speed
            self.written += lanes * asked.lane_bytes
            self.busy_until = max(self.busy_until, self.now) + lanes * asked.lane_bytes / asked.bandwidth / 1e9
            yield SAVE, max(lanes * asked.save_seconds, self.busy_until - self.now)
            work = min(node.trained * node.speed, self.left[pack])
            self.left[pack], self.work = self.left[pack] - work, self.work + work
            self.kept, node.trained = self.kept + node.trained, 0.0
        if self.left[pack] > DONE:
            self.cut_off(pack)
        else:
            self.unfinished -= 1

    def cut_off(self, pack: int, patience: float = 0.0) -> None:
        self.restarts += 1
        self.later(patience + self.asked.requeue, self.dispatch, pack)

    def preempt(self, node: Node) -> None:
        node.leaving = True
        if node.phase in (START, TRAIN):
            self.advance(node)

    def fail(self, node: Node) -> None:
        if node.phase in (START, TRAIN, SAVE):
            self.cut_off(node.pack, self.asked.patience)
        if node.phase != DOWN:
            node.task = iter([(DOWN, self.asked.repair)])
            self.advance(node)
            self.lost, node.trained = self.lost + node.trained, 0.0

    def figures(self) -> list[float]:
        """Hours, % of the nodes' time (waste, and its kinds), restarts, GB/s written (mean, peak)."""
        asked, whole = self.asked, len(self.nodes) * self.now
        kinds = whole - self.kept, self.spent[START], self.spent[SAVE], self.lost, self.spent[IDLE] + self.spent[DOWN]
        alone = asked.lane_bytes / 1e9 / asked.save_seconds if asked.save_seconds else math.inf
        metrics = asked.metrics_bytes / 1e9 * asked.cores * len(self.nodes) / asked.step_seconds
        mean = (self.written + asked.metrics_bytes * self.steps * asked.lanes) / 1e9 / self.now
        peak = min(asked.bandwidth, self.most_writing * alone) + metrics
        return [self.now / 3600, *(100 * kind / whole for kind in kinds), self.restarts, mean, peak]


def check(asked: Arguments) -> None:
    """Raises ValueError where there is nothing to simulate, or no end to it."""
    for field in dataclasses.fields(asked):
        name, value, whole = field.name, getattr(asked, field.name), "int" in str(field.type)
        endless = name in ("intervals", "bandwidth", "mtbf_hours")
        positive, values = endless or name == "step_seconds", np.atleast_1d(np.asarray(value, float))
        good = (values >= 1 if whole else values > 0 if positive else values >= 0) & (np.isfinite(values) | endless)
        if not values.size or not good.all():
            accepted = "numbers of at least 1" if whole else "numbers above 0" if positive else "a number from 0 on"
            raise ValueError(f"{name} is {value}: give {accepted}{'' if endless else ', none of them infinite'}.")
    unsaved = min(max(asked.intervals), pack_seconds(asked, max(asked.steps), min(max(asked.pack_lanes), asked.lanes)))
    if (least := (asked.start + asked.cold + unsaved) / 5 / 3600) > asked.mtbf_hours:
        raise ValueError(f"mtbf_hours is {asked.mtbf_hours}: packs would never end; at least {least:.3g} is accepted.")


def verdict(asked: Arguments, steps: int, found: dict[tuple[float, float], float]) -> str:
    """What wastes least of (hours of a pack, interval) -> waste, which lengths come near, and what arithmetic says."""
    (hours, every), least = min(found.items(), key=lambda item: item[1])
    near = [length for (length, _), waste in found.items() if waste <= least + NEAR]
    ideal = asked.lanes * steps * asked.step_seconds / asked.nodes / asked.cores
    saved = f"saved every {every:,.0f} s" if math.isfinite(every) else "saved at the end alone"
    return (
        f"Lanes of {steps:,} steps: packs of {hours:.2f} hours, {saved}, waste least, {least:.1f}%; "
        f"packs of {min(near):.2f} to {max(near):.2f} hours waste at most {NEAR:g}% of all time more. "
        f"Arithmetic, the root of 2 x start x {ideal / 3600:.2f} h of nothing but training, says "
        f"{math.sqrt(2 * (asked.start + asked.warm) * ideal) / 3600:.2f} hours.\n"
    )


def main(asked: Arguments) -> None:
    """Simulates, and prints a table and its verdict for every length of lanes.

    Raises:
        ValueError: an argument is not accepted.
    """
    check(asked)
    console = Console(width=140)
    for steps in asked.steps:
        hours = {min(n, asked.lanes): pack_seconds(asked, steps, min(n, asked.lanes)) / 3600 for n in asked.pack_lanes}
        tried = {(n, x if x < 3600 * hours[n] else math.inf) for n in hours for x in asked.intervals}
        table, found = Table(*TITLES, *RATES, box=None, title=f"{asked.lanes:,} lanes of {steps:,} steps"), {}
        for lanes, every in sorted(tried):
            several = [Cluster(asked, steps, lanes, every, seed).run().figures() for seed in range(asked.seeds)]
            wall, waste, *kinds, restarts, mean, peak = np.mean(several, 0)
            found[hours[lanes], every] = waste
            shares = f"{waste:.1f} ± {np.ptp([one[1] for one in several]) / 2:.1f}", *(f"{kind:.1f}" for kind in kinds)
            pack = f"{lanes:,}", f"{hours[lanes]:.2f}", f"{every:,.0f}"
            table.add_row(*pack, f"{wall:.2f}", *shares, f"{restarts:,.0f}", f"{mean:.2f}", f"{peak:.2f}")
        console.print(table)
        console.print(verdict(asked, steps, found))


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
