"""Rivals without an atlas: the one policy of a run with a mix of damages walks on, whatever becomes of the robot."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.recovering.rows import Case
from srl_jax.atlas import alone
from srl_jax.atlas.robots import CRobot
from srl_jax.job import students
from srl_jax.job.plan import parse_mix
from srl_jax.job.students import Run

NAME = "generalist"


class Generalist(NamedTuple):
    """What a run has learned for all of its damages."""

    run: Run
    mix: frozenset[str]  # damages that its robots had

    def walk(self, lots: Sequence[Case], bodies: Sequence[CRobot], seconds: float) -> str:
        """Walks robots, before the damage and after it, lanes of several seeds in turn; how many damages it knew."""
        lanes = self.run.lanes_of(self.run.algos[0])
        each = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(self.run.policy(lane) for lane in lanes))
        policies = jax.tree.map(lambda leaf: leaf[np.arange(len(bodies)) % len(lanes)], each)
        alone.walk(alone.walker(self.run.robot), policies, bodies, seconds=seconds)
        return f"trained on the damage of {np.mean([lot.damage in self.mix for lot in lots]):.2f} of these robots"


def methods(runs: Sequence[Path]) -> dict[str, Callable[[Sequence[Case], Sequence[CRobot], float], str]]:
    """How each run's policies walk robots, by what tables call it.

    Raises:
        ValueError: there is none, or one is not finished, had no mix, another task, or sees what no robot senses.
    """
    if not runs:
        raise ValueError(f"generalists is empty: {NAME} needs finished runs, trained with --damage-mix.")
    found = {}
    for path in runs:
        run = students.open_run(path)
        config = run.config
        if not config.damage_mix or config.task != "x" or config.env.observation == "full":
            raise ValueError(
                f"generalists has {path}, trained with damage_mix={config.damage_mix!r}, task={config.task} and "
                f"env.observation={config.env.observation}: a mix, x, and onboard or rates are needed."
            )
        name = f"{NAME} history {config.env.history}" if config.env.history else NAME
        found[name if name not in found else f"{name} {path.name}"] = Generalist(run, frozenset(parse_mix(config))).walk
    return found
