"""What the policies that ship are worth: robots walk from the stance in C MuJoCo, damaged, beside pi_B.

    python -m experiments.shipped

For x: m/s along x. For p2p: goals reached in a minute, each drawn about where the last was reached. A robot that tips
over comes no further, and its fall is counted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax import pretrained
from srl_jax.cli.ending import leave
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.show.walk import Walk
from srl_jax.show.walker import Walker, by_policy, tripod


@dataclass(frozen=True)
class Arguments:
    """How much is tried."""

    tasks: tuple[str, ...] = ("x", "p2p")
    names: tuple[str, ...] = ("ddpg", "srl")
    """Of what ships, beside pi_B; also atlas, for x."""
    seconds: float = 15.0
    """Of each walk."""
    starts: int = 4
    """Walks of each policy."""


class Score(NamedTuple):
    """Of one policy under one damage."""

    worth: float  # m/s for x, goals in a minute for p2p; the mean of all walks
    falls: int


def judge(walker: Walker, damage: str, seconds: float, starts: int) -> Score:
    """Some walks from the stance, each of its own start and goals.

    Args:
        walker: who walks.
        damage: a name of `damage_names`.
        seconds: of each walk.
        starts: how many.
    """
    ends = [list(Walk(walker, damage, 0, seed).until(round(seconds * CONTROL_HZ)))[-1] for seed in range(starts)]
    worth = [60.0 * end.reached if walker.task == "p2p" else end.qpos[0] for end in ends]
    return Score(float(np.mean(worth)) / seconds, sum(end.fell for end in ends))


def rows(arguments: Arguments, task: str) -> Iterator[tuple[str, list[Score]]]:
    """A damage, and what pi_B and the others are worth under it.

    Raises:
        ValueError: a name or the task does not ship.
    """
    for name in arguments.names:
        pretrained.load(name, task=task, damage=HEALTHY)
    for damage in (own.damage for own in pretrained.names() if own[:2] == ("srl", task)):
        learned = [by_policy(pretrained.load(name, task=task, damage=damage)) for name in arguments.names]
        yield damage, [judge(own, damage, arguments.seconds, arguments.starts) for own in (tripod(task), *learned)]


def main(arguments: Arguments) -> None:
    """Prints a table for each task.

    Raises:
        ValueError: a number that is not positive, or a name or task that does not ship.
    """
    if arguments.seconds <= 0.0 or arguments.starts < 1:
        raise ValueError(f"seconds is {arguments.seconds} and starts {arguments.starts}; both must be positive.")
    for task in arguments.tasks:
        unit = "goals a minute" if task == "p2p" else "m/s"
        table = Table(
            "damage", "pi_B", *arguments.names, title=f"{task}, {unit}; falls of {arguments.starts}", box=None
        )
        for damage, scores in rows(arguments, task):
            table.add_row(damage, *(f"{score.worth:.2f}, {score.falls}" for score in scores))
        Console(width=110).print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
