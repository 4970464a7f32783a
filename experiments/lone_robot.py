"""What minutes of one robot's learning are worth: SRL against its warm start, and against the policy it starts from.

    python -m srl_jax.run --preset robot --damage losses21 --algos srl,ddpg_warm,pi_b --seeds 3 --out runs/lone
    python -m experiments.lone_robot runs/lone --minutes 2 8

Distances of the student alone, as shares of the healthy tripod's: interquartile mean and 95 % interval over seeds and
damages, and the share of lanes that recovered (no fall in any episode, and half of that distance). Then how probable it
is that SRL walks further than a rival with the same updates, over all damages and over those of one leg and of two.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax import statistics
from srl_jax.cli.ending import leave
from srl_jax.env.interface import CONTROL_HZ
from srl_jax.report.data import Group, RunData, read_metrics

RECOVERED = 0.5  # share of the healthy tripod's distance, without a fall
OURS = "srl"


@dataclass(frozen=True)
class Arguments:
    """Which runs, and when their students are looked at."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Finished runs with --algos srl and others."""
    minutes: tuple[float, ...] = (2.0, 8.0)
    """Of a robot's walking at 20 Hz."""
    join: bool = False
    """Compare SRL of the first run with the methods of all, instead of each run by itself."""


def shares(run: RunData, group: Group, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Of a method's lanes f64[seeds, damages] at an evaluation: the share of the healthy distance, and who recovered.

    Raises:
        ValueError: there was no evaluation at this step.
    """
    far, fell = (run.scores(f"eval/{name}", group) for name in ("distance", "fell"))
    assert far is not None and fell is not None
    (found,) = np.nonzero(far.steps == step)
    if not len(found):
        known = ", ".join(f"{at / CONTROL_HZ / 60:g}" for at in far.steps)
        raise ValueError(f"minutes has {step / CONTROL_HZ / 60:g}: the run was evaluated at {known}.")
    healthy = run.metrics["reference/distance"].values[0][run.grid(group)]
    kept = far.values[found[0]] / healthy
    return kept, (kept >= RECOVERED) & (fell.values[found[0]] == 0.0)


def parts(damages: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Names of groups of damages, and their places."""
    counts = np.array([damage.count("+") + 1 for damage in damages])
    yield "all", np.arange(len(damages))
    for count in np.unique(counts) if len(np.unique(counts)) > 1 else ():
        yield f"{count} lost", np.flatnonzero(counts == count)


def tables(runs: Mapping[str, RunData], step: float, title: str) -> Iterator[Table]:
    """What every method is worth at a step, and how probable it is that SRL of the first run is worth more.

    Args:
        runs: by what is added to the names of their methods.
        step: of the environment.
        title: of the first table.

    Raises:
        ValueError: runs are of different damages, or there was no evaluation at this step.
    """
    found, damages = {}, {}
    for name, run in runs.items():
        for group in run.groups:
            found[f"{group.label}{name}"] = shares(run, group, step)
            damages[f"{group.label}{name}"] = run.damages(group)
    if len({tuple(own) for own in damages.values()}) > 1:
        raise ValueError("runs are of different damages: leave --join out.")
    worth = Table("method", "share of the healthy distance", "recovered", title=title, box=None)
    for label, (kept, recovered) in found.items():
        low, high = statistics.stratified_interval(kept)
        worth.add_row(label, f"{statistics.iqm(kept):.2f} [{low:.2f}, {high:.2f}]", f"{recovered.mean():.2f}")
    yield worth
    first, run = next(iter(runs.items()))
    ours = [f"{group.label}{first}" for group in run.groups if group.algo == OURS]
    groups = list(parts(next(iter(damages.values()))))
    better = Table("probability that", *(name for name, _ in groups), box=None)
    for mine, rival in ((mine, rival) for mine in ours for rival in found if rival not in ours):
        pairs = ((found[mine][0][:, places], found[rival][0][:, places]) for _, places in groups)
        cells = ["{:.2f} [{:.2f}, {:.2f}]".format(*statistics.probability_of_improvement(x, y)) for x, y in pairs]
        better.add_row(f"{mine} > {rival}", *cells)
    yield better


def main(arguments: Arguments) -> None:
    """Prints two tables for every run and moment.

    Raises:
        ValueError: no run, one that has no evaluations, or none at a moment that is asked for.
    """
    if not arguments.runs:
        raise ValueError("runs is empty: give the directory of a finished run, or several.")
    read = {directory.name: read_metrics(directory) for directory in arguments.runs}
    each: list[tuple[str, dict[str, RunData]]] = [(f"{name}, ", {"": run}) for name, run in read.items()]
    if arguments.join:
        each = [("", {f", {name}": run for name, run in read.items()})]
    for name, runs in each:
        for minutes in arguments.minutes:
            for table in tables(runs, round(minutes * 60 * CONTROL_HZ), f"{name}{minutes:g} min"):
                Console(width=140).print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
