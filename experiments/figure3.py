"""The paper's figure: SRL against DDPG on the three tasks, ten seeds each, every damage of the task.

    python -m experiments.figure3 --out docs/figure3.png

Runs each task that has no finished run in `--runs` by the usual command line, then draws the three panels.
"""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from srl_jax.cli.ending import leave
from srl_jax.report import data as report
from srl_jax.report.curves import save_panels

TASKS = ("x", "xy", "p2p")


@dataclass(frozen=True)
class Arguments:
    """Which runs, and what beside the paper's two methods."""

    runs: Path = Path("runs/figure3")
    """A directory with one run per task (x, xy, p2p); what is missing is trained, what is unfinished is resumed."""
    out: Path = Path("docs/figure3.png")
    seeds: str = "10"
    algos: str = "ddpg,srl"
    arguments: tuple[str, ...] = ()
    """More arguments for srl_jax.run."""


def train(task: str, directory: Path, arguments: Arguments) -> None:
    """Makes sure that the task's run is finished."""
    if (directory / "summary.json").exists():
        return
    command = [sys.executable, "-m", "srl_jax.run"]
    if (directory / "config.json").exists():
        command += ["--resume", str(directory)]
    else:
        command += ["--task", task, "--seeds", arguments.seeds, "--algos", arguments.algos, "--out", str(directory)]
        command += arguments.arguments
    subprocess.run(command, check=True)


def main() -> None:
    """Trains what is missing and draws the figure."""
    arguments = tyro.cli(Arguments)
    directories = [arguments.runs / task for task in TASKS]
    for task, directory in zip(TASKS, directories, strict=True):
        train(task, directory, arguments)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    save_panels([report.read_metrics(directory) for directory in directories], "eval/return", arguments.out)
    print(f"Drawn: {arguments.out}")


if __name__ == "__main__":
    leave(main)
