"""Whether what was learned survives better physics: a finished run's students in MJX and in C MuJoCo, also converged.

    python -m experiments.cross_check runs/p2p

Training uses one Newton iteration; "converged" is 2 ms steps and 50 iterations. Same starts in all three.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax.agents.ddpg import student
from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import gait, hexapod
from srl_jax.evaluate import Rollout, converged_model, rollout_c, rollout_mjx
from srl_jax.job import checkpoint, plan
from srl_jax.job import files as output
from srl_jax.program import lanes as lane_table


@dataclass(frozen=True)
class Arguments:
    """Which run, and how much of it."""

    run: Annotated[Path, tyro.conf.Positional]
    episodes: int = 4
    """Episodes of each student."""
    seeds: int = 2
    """Students of each method and damage."""


def numbers(rollouts: list[Rollout]) -> np.ndarray:
    """Success and return of each episode: f[episodes, 2]."""
    return np.array([[float(np.asarray(r.success)), float(np.asarray(r.reward).sum())] for r in rollouts])


def main() -> None:
    """Rolls out and prints the table."""
    arguments = tyro.cli(Arguments)
    config, devices = output.read_config(arguments.run)
    lanes = plan.make(config).lanes
    robot = hexapod.make(config.task, config.env, float(gait.load().frequency))
    parameters = checkpoint.students(arguments.run / "checkpoints")
    layout, steps = lane_table.lay_out(lanes, devices), config.env.episode_steps
    table = Table("method", "damage", "MJX", "C, same settings", "C, converged", title="success, return", box=None)
    for algo, _ in layout.counts:
        policy = partial(student, config=getattr(config, algo))
        for damage in dict.fromkeys(lane.damage for lane in lanes):
            results: list[list[Rollout]] = [[], [], []]
            own = [lane for lane in dict.fromkeys(layout.of(algo)) if lane.damage == damage][: arguments.seeds]
            for lane in own:
                row = layout.of(algo).index(lane)
                acting = jax.tree_util.Partial(policy, jax.tree.map(lambda x, row=row: x[row], parameters[algo]))
                keys = jax.random.split(lane_table.key(lane, "cross_check"), arguments.episodes)
                batch = jax.device_get(rollout_mjx(robot, damages.build(damage), acting, keys, steps))
                results[0] += [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(arguments.episodes)]
                for key in keys:
                    results[1].append(rollout_c(robot, damage, acting, key, steps))
                    fine = converged_model(damage)
                    results[2].append(rollout_c(robot, damage, acting, key, steps, model=fine))
            cells = [numbers(found).mean(0) for found in results]
            table.add_row(algo, damage, *(f"{success:.2f}, {earned:.1f}" for success, earned in cells))
    Console(width=110).print(table)


if __name__ == "__main__":
    leave(main)
