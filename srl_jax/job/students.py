"""What the lanes of a finished run have learned, as policies, for whatever judges or shows them."""

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import jax
from jax.tree_util import Partial

from srl_jax.config import Config
from srl_jax.env.hexapod import Hexapod
from srl_jax.job import checkpoint, files, start
from srl_jax.job import plan as plans
from srl_jax.job import teachers as sources
from srl_jax.job.checkpoint import Networks
from srl_jax.job.plan import Plan
from srl_jax.job.teachers import Behaviour
from srl_jax.program.lanes import Lane, lay_out
from srl_jax.program.state import Program, bind_teachers, student
from srl_jax.types import Params


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run; `open_run` makes it."""

    directory: Path
    config: Config
    plan: Plan
    teachers: tuple[Behaviour, ...]
    program: Program  # its static parts, on one device; nothing of it is compiled
    networks: dict[str, Networks]  # by algorithm

    @property
    def robot(self) -> Hexapod:
        """The robot that was trained, before any damage."""
        return self.program.robot

    @property
    def algos(self) -> tuple[str, ...]:
        """The algorithms, in the order of the run."""
        return self.program.layout.algos

    def lanes_of(self, algo: str) -> list[Lane]:
        """The lanes of an algorithm, its variants one after the other.

        Raises:
            ValueError: the run has no such algorithm.
        """
        found = [lane for lane in self.plan.lanes if lane.algo == algo]
        if not found:
            raise ValueError(f"algo is {algo!r}: {self.directory} has {', '.join(self.algos)}.")
        return found

    def damage(self, lane: Lane) -> str:
        """The damage under which a lane learned last.

        Raises:
            ValueError: its robots had different ones.
        """
        if self.config.damage_mix:
            raise ValueError(
                f"{self.directory} was trained with damage_mix={self.config.damage_mix}: its lanes have no damage of "
                "their own; give a run with damage."
            )
        return self.plan.damage(lane, self.config.steps - 1)

    def learned(self, lane: Lane) -> dict[str, Any]:
        """The "actor" and "critic" of a lane, without a lane axis."""
        trees, place = self.networks[lane.algo]
        return jax.tree.map(lambda x: x[place[lane.index]], trees)

    def taught(self, lane: Lane) -> tuple[Params, ...]:
        """The parameters of a lane's teachers."""
        return tuple(jax.tree.map(lambda x: x[0], teacher.params([lane])) for teacher in self.teachers)

    def advisers(self, lane: Lane) -> tuple[Callable[[jax.Array], jax.Array], ...]:
        """A lane's teachers, each observation f32[O] -> action f32[18]; the first is its pi_B."""
        return bind_teachers(self.program, lane.algo, self.taught(lane))

    def policy(self, lane: Lane) -> Partial:
        """A lane's student, observation f32[O] -> action f32[18], without noise; all of an algorithm compile to one."""
        return student(self.program, lane.algo, self.learned(lane)["actor"], self.taught(lane))


def open_run(directory: Path) -> Run:
    """What a run has learned, by its newest checkpoints.

    Raises:
        ValueError: the directory is no run's, a lane of its has no checkpoint, or a teacher of its was never finished.
    """
    config, _ = files.read_config(directory)
    plan = plans.make(config)
    networks = checkpoint.learned(directory, plan.lanes)
    teachers = sources.load(config, directory, partial(_untaught, directory))
    assert teachers is not None
    program = start.make_program(config, lay_out(plan.lanes, 1), teachers)
    return Run(directory, config, plan, teachers, program, networks)


def _untaught(run: Path, config: Config, path: Path) -> NoReturn:
    del config
    raise ValueError(f"{path} is not finished, and {run} learned from it: go on with it by --resume {run}.")
