"""The paper's figure: SRL against DDPG on the three tasks, ten seeds each, every damage of the task.

    python -m experiments.figure3 --out docs/figure3.png

Runs each task that has no finished run in `--runs` by the usual command line, then draws the three panels. Arguments
that are not listed here go on to it, as in `--seeds 2 --preset smoke`.
"""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from srl_jax.cli.ending import leave
from srl_jax.report.curves import save_panels
from srl_jax.report.data import read_metrics

TASKS = ("x", "xy", "p2p")


@dataclass(frozen=True)
class Arguments:
    """Which runs; every other argument is one of `python -m srl_jax.run`."""

    runs: Path = Path("runs/figure3")
    """A directory with one run per task (x, xy, p2p); what is missing is trained, what is unfinished is resumed."""
    out: Path = Path("docs/figure3.png")
    seeds: str = "10"
    algos: str = "ddpg,srl"


def train(task: str, directory: Path, arguments: Arguments, more: Sequence[str]) -> None:
    """Makes sure that the task's run is finished; `more` are further arguments of a new run.

    Raises:
        ValueError: the run did not finish.
    """
    if (directory / "summary.json").exists():
        return
    words = ["-m", "srl_jax.run"]
    if (directory / "config.json").exists():
        words += ["--resume", str(directory)]
    else:
        words += [
            "--task",
            task,
            "--seeds",
            arguments.seeds,
            "--algos",
            arguments.algos,
            "--out",
            str(directory),
            *more,
        ]
    if subprocess.run([sys.executable, *words]).returncode:
        raise ValueError(f"{' '.join(words)} did not finish: see what it said.")


def main(arguments: Arguments, more: Sequence[str] = ()) -> None:
    """Trains what is missing and draws the figure."""
    directories = [arguments.runs / task for task in TASKS]
    for task, directory in zip(TASKS, directories, strict=True):
        train(task, directory, arguments, more)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    save_panels([read_metrics(directory) for directory in directories], "eval/return", arguments.out)
    print(f"Drawn: {arguments.out}")


if __name__ == "__main__":
    leave(main, *tyro.cli(Arguments, return_unknown_args=True))
