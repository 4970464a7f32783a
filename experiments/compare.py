"""Joins finished runs of one task into one table: methods trained apart, on the same seeds, damages, starts and steps.

    python -m experiments.compare runs/p2p runs/p2p-baselines

Runs that differ in anything but their algorithms are refused.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from srl_jax.cli.ending import leave
from srl_jax.cli.progress import results
from srl_jax.report.curves import save_curves
from srl_jax.report.data import read_metrics
from srl_jax.report.join import join
from srl_jax.report.summary import summarise


@dataclass(frozen=True)
class Arguments:
    """Which runs, and where the joint figure goes."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path | None = None
    """A PNG of the joint curves."""


def main(arguments: Arguments) -> None:
    """Prints the table of methods and the probabilities of improvement."""
    with tempfile.TemporaryDirectory() as folder:
        join(arguments.runs, Path(folder))
        data = read_metrics(folder)
    summary = summarise(data)
    if arguments.out:
        save_curves(data, arguments.out)
    console = Console(width=150)
    console.print(results(summary))
    for found in summary["improvement"]:
        console.print(
            f"P({found['x']} > {found['y']}) in {found['score']}: "
            f"{found['probability']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"
        )


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
