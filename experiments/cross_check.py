"""Whether what was learned survives better physics: a finished run's students in MJX and in C MuJoCo, also converged.

    python -m experiments.cross_check runs/p2p

Training uses one Newton iteration; "converged" is 2 ms steps and 50 iterations. Same starts in all three. Students of a
run whose damage changed meet the last one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.evaluate import Rollout, converged_model, rollout_c, rollout_mjx
from srl_jax.job.students import Run, open_run
from srl_jax.program.lanes import Lane
from srl_jax.program.randomness import lane_keys, per_robot


@dataclass(frozen=True)
class Arguments:
    """Which run, and how much of it."""

    run: Annotated[Path, tyro.conf.Positional]
    algos: str = ""
    """Of these algorithms, separated by commas; all of the run's if empty."""
    episodes: int = 4
    """Episodes of each student."""
    seeds: int = 2
    """Students of each method and damage."""


def numbers(rollouts: Sequence[Rollout]) -> np.ndarray:
    """Success and return of each episode: f[episodes, 2]."""
    return np.array([[float(np.asarray(r.success)), float(np.asarray(r.reward).sum())] for r in rollouts])


def roll(run: Run, lane: Lane, episodes: int) -> np.ndarray:
    """Success and return of a lane's student in MJX, in C MuJoCo and in C MuJoCo converged: f[3, episodes, 2]."""
    policy, damage, steps = run.policy(lane), run.damage(lane), run.config.env.episode_steps
    keys = per_robot(lane_keys([lane], "cross_check"), 0, episodes)[0]
    batch = jax.device_get(rollout_mjx(run.robot, damages.build(damage), policy, keys, steps))
    ours = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(episodes)]
    theirs = [rollout_c(run.robot, damage, policy, key, steps) for key in keys]
    fine = [rollout_c(run.robot, damage, policy, key, steps, model=converged_model(damage)) for key in keys]
    return np.stack([numbers(found) for found in (ours, theirs, fine)])


def main(arguments: Arguments) -> None:
    """Rolls out and prints a line for every method and damage.

    Raises:
        ValueError: a number below 1, an algorithm that the run does not have, or no finished run.
    """
    if arguments.episodes < 1 or arguments.seeds < 1:
        raise ValueError(f"episodes is {arguments.episodes} and seeds {arguments.seeds}; at least 1 each is needed.")
    run = open_run(arguments.run)
    groups: dict[tuple[str, str], list[Lane]] = {}
    for algo in arguments.algos.split(",") if arguments.algos else run.algos:
        for lane in run.lanes_of(algo.strip()):
            groups.setdefault((lane.method, run.damage(lane)), []).append(lane)
    table = Table("method", "damage", "MJX", "C, same settings", "C, converged", title="success, return", box=None)
    for (method, damage), lanes in groups.items():
        found = np.concatenate([roll(run, lane, arguments.episodes) for lane in lanes[: arguments.seeds]], axis=1)
        table.add_row(method, damage, *(f"{success:.2f}, {earned:.1f}" for success, earned in found.mean(1)))
    Console(width=110).print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
