"""Python's part of a run: chunks of the compiled program, with evaluations, checkpoints and files between them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from itertools import repeat
from pathlib import Path
from typing import Any

import jax
import numpy as np

from srl_jax.config import Config
from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.job import checkpoint, files, start, tables
from srl_jax.job.plan import Plan
from srl_jax.job.progress import Listener, Pace, Progress, Totals
from srl_jax.job.teachers import Behaviour
from srl_jax.program import engine as engines
from srl_jax.program import tally as tallies
from srl_jax.program.evaluation import evaluate
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import REFERENCE, STUDENT, TEACHER, TRAIN, LaneData, Mode, TrainState
from srl_jax.program.tally import Measured, Tally
from srl_jax.report import showcase
from srl_jax.report.curves import save_curves
from srl_jax.report.data import read_metrics
from srl_jax.report.summary import summarise

LATEST = ("return", "success")  # what the display shows of an evaluation


class Loop:
    """One run of lanes that are trained at once; `go` does it all."""

    def __init__(
        self,
        config: Config,
        plan: Plan,
        directory: Path,
        devices: int,
        teachers: Sequence[Behaviour],
        listener: Listener,
        stopped: Callable[[], bool],
    ):
        self.config, self.plan, self.directory = config, plan, directory
        self.teachers, self.listener, self.stopped = teachers, listener, stopped
        self.layout = lay_out(plan.lanes, devices, plan.room)
        self.engine = engines.Engine(start.make_program(config, self.layout, teachers))
        self.program = self.engine.program
        self.lanes = start.make_lanes(self.program, config, teachers, "train", plan.damages(self.layout.rows, 0))
        self.learners = sum(self.program.agents[lane.algo].update is not None for lane in plan.lanes)
        self.totals = Totals()
        self.paces = {True: Pace(), False: Pace()}  # of training and of evaluations, which are several times as fast
        self.evaluated = self.stage = -1  # the steps at which students were last judged, and the damage last set
        self.latest: dict[str, dict[str, float]] = {}
        self.metrics: tables.Metrics

    def go(self) -> dict[str, Any] | None:
        """Trains, then writes videos, summary and curves; None where it was stopped (and saved)."""
        with checkpoint.manager(self.directory / "checkpoints") as keeper:
            begun = self.begin(keeper)
            if begun is None:
                return None
            state, tally = begun
            while True:
                state, tally = self.due(keeper, state, tally)
                if self.stopped():
                    self.save(keeper, state, tally, last=True)
                    return None
                if int(state.clock) >= self.config.steps:
                    break
                state, tally = self.train(state, tally)
            if keeper.latest_step() != int(state.clock):
                self.save(keeper, state, tally, last=True)
            self.show("summary", int(state.clock))
            data = read_metrics(self.directory)
            chosen = showcase.median_lanes(self.plan.lanes, data.last("eval/return"))
            damage = {lane.index: self.plan.damage(lane, self.config.steps - 1) for lane in self.plan.lanes}
            # Rendered while the checkpoint is being written; the summary comes when both are there.
            showcase.save_videos(self.directory / "videos", self.program, state, self.lanes, chosen, damage)
        summary = summarise(data) | {"machine": self.machine()}
        files.write_json(self.directory / "summary.json", summary)
        save_curves(data, self.directory / "curves.png")
        return summary

    def begin(self, keeper) -> tuple[TrainState, Tally] | None:
        """The state to go on from: the newest checkpoint's, or step 0 with its reference measurements."""
        self.show("preparing", 0)
        state, tally = start.init_state(self.engine, self.lanes), tallies.empty(self.program)
        found = checkpoint.restore(keeper, self.program, state, self.lanes, tally)
        if found is not None:
            state, self.lanes, tally, about = found
            self.metrics = tables.Metrics(self.directory, keep=about["metrics"])
            self.totals = Totals(**about["totals"])
            self.evaluated, self.stage = about["evaluated"], about["stage"]
            self.lanes = self.under_damage(self.lanes, max(self.stage, 0))
            return state, tally
        self.metrics = tables.Metrics(self.directory)
        self.show("compiling, then following pi_B", 0)
        rows = self.layout.rows
        healthy = engines.with_damage(self.program, self.lanes, [damage_names.HEALTHY] * len(rows))
        prior = engines.with_stream(self.program, healthy, "prior")
        state, self.lanes = start.from_behaviour(self.engine, state, self.lanes, prior, self.teachers[0])
        self.show("evaluating pi_B", 0)
        healthy = healthy._replace(prior=self.lanes.prior)
        state, pi_b = self.measure(state, healthy, TEACHER())
        state, common = (state, pi_b) if self.follows_the_reference else self.measure(state, healthy, REFERENCE())
        if self.stopped():
            return None
        self.metrics.write([*self.rows(0, "healthy", pi_b), *self.rows(0, "reference", common)])
        return state, tally

    @property
    def follows_the_reference(self) -> bool:
        """Whether pi_B is the tuned gait itself, so that its measurement is the common reference too."""
        return self.teachers[0].apply is gaits.walker(self.program.robot.anatomy)

    def due(self, keeper, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
        """What is to be done at the present step before training goes on; nothing of it where the run is stopped."""
        clock, train = int(state.clock), self.config.train
        if clock % train.evaluate_every == 0 and self.evaluated < clock:
            state, tally = self.evaluate(state, tally)
        stage = max(first for first, _ in self.plan.stages if first <= clock)
        if self.stage < stage and clock < self.config.steps and not self.stopped():
            state = self.enter_stage(state, stage)
        wanted = clock % train.checkpoint_every == 0 and 0 < clock < self.config.steps
        if wanted and keeper.latest_step() != clock and not self.stopped():
            self.save(keeper, state, tally)
        return state, tally

    def evaluate(self, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
        """Writes what training and an evaluation of the student alone have shown since the last one."""
        clock = int(state.clock)
        state, judged = self.measure(state, self.lanes, STUDENT())
        if self.stopped():
            return state, tally
        rows = [*self.rows(clock, "eval", judged)]
        self.latest = self.means_by_algo(judged)
        if clock:
            seen = tallies.means(self.program, tally, training=True), np.asarray(state.alive)
            gauges = self.engine.gauges(state.agents), np.asarray(state.alive)
            rows = [*self.rows(clock, "train", seen), *self.rows(clock, "gauge", gauges), *rows]
        self.metrics.write(rows)
        self.evaluated = clock
        self.show("training", clock)
        return state, tallies.empty(self.program)

    def enter_stage(self, state: TrainState, stage: int) -> TrainState:
        """The damage that is in force from here on, which agents are told and pi_B is measured under."""
        self.lanes = self.under_damage(self.lanes, stage)
        if stage:
            state = state._replace(agents=engines.reopened(self.program, state.agents, int(state.clock)))
        state, pi_b = self.measure(state, self.lanes, TEACHER())
        if self.stopped():
            return state
        self.metrics.write([*self.rows(int(state.clock), "teacher", pi_b)])
        self.stage = stage
        return state

    def under_damage(self, lanes: LaneData, step: int) -> LaneData:
        """The rows under the damage in force at a step."""
        return engines.with_damage(self.program, lanes, self.plan.damages(self.layout.rows, step))

    def train(self, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
        """Trains up to the next evaluation or change of damage, or until the run is stopped."""
        clock, train = int(state.clock), self.config.train
        stops = [first for first, _ in self.plan.stages if first > clock]
        stop = min([(clock // train.evaluate_every + 1) * train.evaluate_every, *stops])
        return self.advance(state, tally, self.lanes, TRAIN(), (stop - clock) // train.environments)

    def advance(
        self, state: TrainState, tally: Tally, lanes: LaneData, mode: Mode, steps: int
    ) -> tuple[TrainState, Tally]:
        """``engine.chunk`` in slices of some seconds, with a look at signals and at the display between them."""
        training = bool(mode.learn)
        pace = self.paces[training]
        while steps and not self.stopped():
            count = min(steps, pace.steps)
            with pace.timing(count), self.totals.training() if training else nullcontext():
                state, tally = jax.block_until_ready(self.engine.chunk(state, tally, lanes, mode, count))
            steps -= count
            if training:
                self.totals.trained += count * self.config.train.environments
                self.show("training", int(state.clock))
        return state, tally

    def measure(
        self, state: TrainState, lanes: LaneData, mode: Mode
    ) -> tuple[TrainState, tuple[dict[str, Measured], np.ndarray]]:
        """Episodes from the fixed evaluation starts: their means, and which rows were finite throughout."""
        lanes = engines.with_stream(self.program, lanes, "evaluate")
        episodes = self.config.evaluation.episodes
        state, tally, finite = evaluate(self.engine, state, lanes, mode, episodes, advance=self.advance)
        return state, (tallies.means(self.program, tally, training=False), finite)

    def rows(self, step: int, prefix: str, seen: tuple[dict[str, Measured], np.ndarray]) -> Iterator[tables.Row]:
        """Measurements as rows of metrics.csv; NaN for rows that were not finite."""
        measured, finite = seen
        for name, (rows, values) in measured.items():
            lanes, values = self.layout.lanes[rows], np.where(finite[rows], values, np.nan)
            kept = lanes >= 0
            yield from zip(repeat(step), lanes[kept].tolist(), repeat(f"{prefix}/{name}"), values[kept].tolist())

    def means_by_algo(self, seen: tuple[dict[str, Measured], np.ndarray]) -> dict[str, dict[str, float]]:
        """What the display shows of an evaluation: means over the lanes that are finite."""
        measured, finite = seen
        found: dict[str, dict[str, float]] = {algo: {} for algo in self.layout.algos}
        for algo, rows in self.layout.rows_of.items():
            kept = rows[finite[rows] & (self.layout.lanes[rows] >= 0)]
            for name in LATEST:
                if len(kept):
                    found[algo][name] = float(np.mean(measured[name].values[kept]))
        return found

    def save(self, keeper, state: TrainState, tally: Tally, *, last: bool = False) -> None:
        """Saves the state, and all that this object needs to go on from it."""
        about = {
            "metrics": self.metrics.size,
            "totals": self.totals.stored(self.engine.compile_seconds),
            "evaluated": self.evaluated,
            "stage": self.stage,
        }
        checkpoint.save(keeper, self.program, state, self.lanes, tally, about, last=last)

    def show(self, phase: str, step: int) -> None:
        """Tells the listener how far the run is."""
        rate, updates = self.totals.rates(self.config, len(self.plan.lanes), self.learners)
        seconds, steps = self.totals.training_seconds, self.config.steps
        self.listener(Progress(self.directory, phase, step, steps, seconds, rate, updates, self.latest))

    def machine(self) -> dict[str, Any]:
        """What the run took, earlier processes included."""
        lanes, devices = len(self.plan.lanes), self.layout.devices
        return self.totals.summary(self.config, lanes, self.learners, devices, self.engine.compile_seconds)
