"""Students trained with and without `--env.randomise`, on robots that are not the one of the simulation.

    python -m experiments.changed_robots runs/plain runs/wide ...

Every network of the finished runs walks with its own damage from the start, without noise of its own: in C MuJoCo as
the robot is modelled, in C MuJoCo with constants drawn anew for every walk (the same draws for all), and over the
simulated servo bus. A robot that falls comes no further.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from experiments.walks.bus import over_bus
from srl_jax import statistics
from srl_jax.atlas.robots import CRobot, World
from srl_jax.cli.ending import leave
from srl_jax.cli.run import quiet
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.job import export
from srl_jax.portable import Policy
from srl_jax.report.files import read_settings
from srl_jax.robot.policy import Walker, checked

MODELLED = World(friction=1.0, noise=0.0)


@dataclass(frozen=True)
class Arguments:
    """Which students, and how much they walk."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Finished runs of task x, --env.observation onboard or rates."""
    seconds: float = 10.0
    """Of each walk."""
    walks: int = 4
    """Of a student in each world."""


class Walk(NamedTuple):
    """What came of one."""

    speed: float  # m/s ahead
    fell: bool


def drawn(seed: int) -> World:
    """A robot whose constants are anywhere from well below to well above the model's."""
    random = np.random.default_rng((7, seed))
    return World(
        friction=random.uniform(0.4, 1.2),
        mass=random.uniform(0.8, 1.3),
        gain=random.uniform(0.7, 1.1),
        slope=random.uniform(-5.0, 5.0),
        delay=int(random.integers(3)),
        lost=random.uniform(0.0, 0.05),
        bias=1.0,
        encoder=0.29,
    )


def in_mujoco(policy: Policy, seconds: float, seed: int, world: World) -> Walk:
    """A walk in C MuJoCo at 2 ms."""
    robot, walker = CRobot(policy.about["damage"], 0, seed, world), Walker(policy)
    senses = robot.reset()
    for _ in range(round(seconds * CONTROL_HZ)):
        senses = robot.step(walker.act(senses)[1])
        walker.advance()
        if robot.fell:
            break
    return Walk(float(robot.positions[-1][0]) / seconds, robot.fell)


def on_the_bus(policy: Policy, seconds: float, seed: int) -> Walk:
    """A walk over the simulated bus."""
    trip = over_bus(policy, seconds, policy.about["damage"], seed=seed)
    return Walk(float(trip.way[0]) / seconds, trip.fell)


WORLDS: dict[str, Callable[[Policy, float, int], Walk]] = {
    "as modelled": lambda policy, seconds, seed: in_mujoco(policy, seconds, seed, MODELLED),
    "other constants": lambda policy, seconds, seed: in_mujoco(policy, seconds, seed, drawn(seed)),
    "over the bus": on_the_bus,
}


def named(directory: Path) -> str:
    """What a run's students were trained with."""
    env = read_settings(directory)["env"]
    return f"{env['randomise']}, {env['history']} steps behind" if env["history"] else env["randomise"]


def cell(speeds: np.ndarray, falls: np.ndarray) -> str:
    """Interquartile mean of the speed f64[seeds, damages] with its 95 % interval, and the share of falls."""
    low, high = statistics.stratified_interval(speeds)
    return f"{statistics.iqm(speeds):.3f} [{low:.3f}, {high:.3f}], {falls.mean():.2f}"


def rows(directory: Path, arguments: Arguments) -> list[tuple[str, ...]]:
    """A row for every method of a run."""
    policies = export.from_run(directory)
    found = []
    for method in dict.fromkeys(policy.about["method"] for policy in policies):
        own = [checked(policy) for policy in policies if policy.about["method"] == method]
        shape = len({policy.about["seed"] for policy in own}), len({policy.about["damage"] for policy in own})
        own.sort(key=lambda policy: (policy.about["seed"], policy.about["damage"]))
        cells = []
        for walk in WORLDS.values():
            walks = np.array(
                [[walk(policy, arguments.seconds, seed) for seed in range(arguments.walks)] for policy in own]
            )
            speeds, falls = walks.mean(axis=1).T
            cells.append(cell(speeds.reshape(shape), falls))
        found.append((named(directory), method, *cells))
    return found


def main(arguments: Arguments) -> None:
    """Prints the table.

    Raises:
        ValueError: no run, or a number that is not positive; a run is not finished, or its students read what no robot
            senses or are not for x.
    """
    if not arguments.runs:
        raise ValueError("runs is empty: give the directory of a finished run, or several.")
    if arguments.seconds <= 0.0 or arguments.walks < 1:
        raise ValueError(f"seconds is {arguments.seconds} and walks {arguments.walks}; both must be positive.")
    quiet()
    table = Table("trained with", "method", *(f"{name}: m/s, falls" for name in WORLDS), box=None)
    for directory in arguments.runs:
        for row in rows(directory, arguments):
            table.add_row(*row)
    Console(width=160).print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
