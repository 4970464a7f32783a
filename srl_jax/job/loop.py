"""Python's part of a run: chunks of the compiled program, with evaluations, checkpoints and files between them."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from srl_jax import machine
from srl_jax.config import Config
from srl_jax.env.hexapod import SUBSTEPS
from srl_jax.job import checkpoint, plan, start
from srl_jax.job import files as output
from srl_jax.job import teachers as sources
from srl_jax.program import engine
from srl_jax.program import lanes as lane_table
from srl_jax.program.state import STUDENT, TEACHER, TRAIN, LaneData, Mode, Tally, TrainState
from srl_jax.report import data as report
from srl_jax.report import showcase

SLICE = 1_000  # environment steps between two looks at the clock, at signals and at the progress display


@dataclasses.dataclass
class Progress:
    """What a display shows."""

    phase: str
    step: int
    steps: int
    elapsed: float  # s of training
    environment_rate: float  # environment steps per second, all lanes
    update_rate: float  # gradient updates per second, all lanes
    latest: dict[str, dict[str, float]]  # per algorithm, means over its lanes at the last evaluation
    directory: Path  # where the files go


Listener = Callable[[Progress], None]


def run(
    config: Config,
    directory: Path,
    devices: int,
    *,
    exact: bool = True,
    resume: bool = False,
    listener: Listener = lambda progress: None,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Any] | None:
    """Trains every lane of a configuration and leaves the files of a run.

    Args:
        config: what to do.
        directory: where the files go; new, or of a run to resume.
        devices: over how many devices lanes are laid.
        exact: the files go to `directory` or nowhere; otherwise a number is appended where the name is taken.
        resume: go on from the newest checkpoint in `directory`.
        listener: called now and then with the progress.
        stopped: asked now and then; once True, the run saves its state and returns.

    Returns:
        The summary that was written, or None where the run was stopped (resume it).

    Raises:
        ValueError: the configuration, the directory or a checkpoint is unusable; nothing has been written then.
    """
    plans = plan.make(config)
    layout = lane_table.lay_out(plans.lanes, devices)
    plan.check_memory(config, len(layout.rows))
    if exact and not resume:
        output.check_empty(directory)
    sources.check(config)
    directory = directory if resume else output.claim(directory, exact=exact)
    with output.in_use(directory):
        listener(Progress("preparing", 0, config.steps, 0.0, 0.0, 0.0, {}, directory))
        output.write_config(directory, config, devices)
        output.write_lanes(directory, plans.lanes)
        teachers = sources.load(config, directory, devices, listener=listener, stopped=stopped)
        if teachers is None:
            return None
        return _Run(config, plans, layout, directory, teachers, listener, stopped).go()


class _Run:
    """The state of a run in progress; see `run`."""

    def __init__(
        self,
        config: Config,
        plans: plan.Plan,
        layout: lane_table.Layout,
        directory: Path,
        teachers: tuple[sources.Behaviour, ...],
        listener: Listener,
        stopped: Callable[[], bool],
    ):
        self.config, self.plan, self.layout, self.directory = config, plans, layout, directory
        self.listener, self.stopped = listener, stopped
        program = engine.make_program(config, layout, teachers)
        self.program, self.engine, self.network = program, engine.Engine(program), teachers[0].network
        self.lanes = engine.lane_data(program, teachers, "train", self.damages(0))
        self.evaluation_keys = engine.stream_keys(program, "evaluate")
        self.seconds = 0.0  # spent training in this process
        self.trained = 0  # environment steps of a lane in this process
        self.latest: dict[str, dict[str, float]] = {}

    def damages(self, step: int) -> list[str]:
        return [self.plan.damage(lane, step) for lane in self.layout.rows]

    def go(self) -> dict[str, Any] | None:
        with checkpoint.manager(self.directory / "checkpoints") as keeper:
            state, tally = self.begin(keeper)
            while int(state.clock) < self.config.steps:
                if self.stopped():
                    checkpoint.save(keeper, state, self.lanes, tally, last=True)
                    return None
                state, tally = self.advance(state, tally)
                if int(state.clock) % self.config.train.evaluate_every == 0:
                    state, tally = self.evaluate(state, tally)
                clock = int(state.clock)
                if clock % self.config.train.checkpoint_every == 0 and clock < self.config.steps:
                    checkpoint.save(keeper, state, self.lanes, tally)
            if keeper.latest_step() != int(state.clock):
                checkpoint.save(keeper, state, self.lanes, tally, last=True)
            self.show("summary", int(state.clock))
            data = report.read_metrics(self.directory)
            damage = {lane.index: self.plan.damage(lane, self.config.steps - 1) for lane in self.plan.lanes}
            chosen = showcase.median_lanes(self.plan.lanes, data.metrics["eval/return"][self.config.steps])
            # Rendered while the checkpoint is being written; the summary comes when both are there.
            showcase.save_videos(self.directory / "videos", self.program, state, self.lanes, chosen, damage)
        return self.summarise(data)

    def begin(self, keeper) -> tuple[TrainState, Tally]:
        """The state to go on from: the newest checkpoint's, or step 0 with its reference measurements."""
        self.show("preparing", 0)
        state = start.init_state(self.engine, self.lanes)
        tally = engine.empty_tally(self.program)
        found = checkpoint.restore(keeper, state, self.lanes, tally)
        if found is not None:
            state, self.lanes, tally = found
            state = state._replace(clock=engine.on_all(self.program, state.clock))
            self.metrics = output.Metrics(self.directory, keep_until=int(state.clock))
            self.set_damage(int(state.clock))
            return state, tally
        self.metrics = output.Metrics(self.directory)
        self.show("compiling, then following pi_B", 0)
        healthy = engine.with_damage(self.program, self.lanes, ["healthy"] * len(self.layout.rows))
        prior = healthy._replace(key=engine.stream_keys(self.program, "prior"))
        state, self.lanes = start.from_behaviour(self.engine, state, self.lanes, prior, self.network)
        self.show("evaluating pi_B", 0)
        state = self.measure(state, healthy._replace(prior=self.lanes.prior), TEACHER(), "healthy")
        state = self.measure(state, self.lanes, TEACHER(), "teacher")
        state = self.measure(state, self.lanes, STUDENT(), "eval")
        return state, tally

    def set_damage(self, step: int) -> None:
        self.lanes = engine.with_damage(self.program, self.lanes, self.damages(step))

    def advance(self, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
        """Trains up to the next multiple of SLICE, evaluation or change of damage, whichever comes first."""
        clock, every = int(state.clock), self.config.train.environments
        if any(start_ == clock and clock > 0 for start_, _ in self.plan.stages):
            self.set_damage(clock)
        unit = max(SLICE // every, 1) * every
        stops = [first for first, _ in self.plan.stages if first > clock]
        for period in (unit, self.config.train.evaluate_every):
            stops.append((clock // period + 1) * period)
        begin = time.perf_counter()
        state, new = self.engine.chunk(state, self.lanes, TRAIN(), (min(stops) - clock) // every)
        jax.block_until_ready(state)
        self.seconds += time.perf_counter() - begin
        self.trained += min(stops) - clock
        self.show("training", min(stops))
        return state, jax.tree.map(lambda a, b: a + b, tally, new)

    def evaluate(self, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
        """Writes what training and an evaluation of the student alone have shown since the last one."""
        self.metrics.write(self.rows(int(state.clock), "train", tally, state))
        state = self.measure(state, self.lanes, STUDENT(), "eval")
        self.show("training", int(state.clock))
        return state, engine.empty_tally(self.program)

    def measure(self, state: TrainState, lanes: LaneData, mode: Mode, prefix: str) -> TrainState:
        """One episode of every robot from the fixed evaluation starts; leaves training's robots and clock alone."""
        lanes = lanes._replace(key=self.evaluation_keys)
        clock, world, alive = jax.device_get(state.clock), state.world, np.asarray(state.alive)
        state = state._replace(world=self.engine.new_world(lanes))
        state, tally = self.engine.chunk(state, lanes, mode, self.config.env.episode_steps)
        state = state._replace(
            clock=engine.on_all(self.program, clock), world=world, alive=engine.on_rows(self.program, alive)
        )
        self.metrics.write(self.rows(int(clock), prefix, tally, state))
        return state

    def rows(self, step: int, prefix: str, tally: Tally, state: TrainState) -> list[output.Row]:
        """A tally as rows of metrics.csv; NaN for frozen lanes."""
        values = engine.means(self.program, jax.device_get(tally), training=prefix == "train")
        alive = np.asarray(state.alive)
        rows: list[output.Row] = []
        for row, (lane, padding) in enumerate(zip(self.layout.rows, self.layout.padding, strict=True)):
            if not padding:
                found = values[row] if alive[row] else dict.fromkeys(values[row], float("nan"))
                rows += [(step, lane.index, f"{prefix}/{name}", value) for name, value in found.items()]
        if prefix == "eval":
            self.latest = _means_by_algo(self.plan.lanes, rows)
        return rows

    def show(self, phase: str, step: int) -> None:
        lanes, train = len(self.plan.lanes), self.config.train
        rate = lanes * self.trained / self.seconds if self.seconds else 0.0
        updates = rate / (train.environments * train.update_every)
        told = Progress(phase, step, self.config.steps, self.seconds, rate, updates, self.latest, self.directory)
        self.listener(told)

    def summarise(self, data: report.RunData) -> dict[str, Any]:
        """Writes summary.json and curves.png from the run's metrics."""
        rate = len(self.plan.lanes) * self.trained / self.seconds if self.seconds else 0.0
        summary = report.summarise(data) | {
            "machine": {
                "devices": self.layout.devices,
                "lanes": len(self.plan.lanes),
                "training_seconds": round(self.seconds, 1),
                "compile_seconds": round(self.engine.compile_seconds, 1),
                "environment_steps_per_second": round(rate),
                "physics_steps_per_second": round(rate * SUBSTEPS),
                "updates_per_second": round(rate / (self.config.train.environments * self.config.train.update_every)),
                "peak_memory_gib": machine.peak_memory_gib(),
            }
        }
        output.write_json(self.directory / "summary.json", summary)
        report.save_curves(data, self.directory / "curves.png")
        return summary


def _means_by_algo(lanes: list[lane_table.Lane], rows: list[output.Row]) -> dict[str, dict[str, float]]:
    sums: dict[str, dict[str, list[float]]] = {}
    for _, lane, name, value in rows:
        if np.isfinite(value):
            sums.setdefault(lanes[lane].algo, {}).setdefault(name.removeprefix("eval/"), []).append(value)
    return {algo: {name: float(np.mean(v)) for name, v in found.items()} for algo, found in sums.items()}
