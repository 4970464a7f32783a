"""Joins finished runs of one task into one table: methods trained apart, on the same seeds, damages, starts and steps.

    python -m experiments.compare runs/p2p runs/p2p-baselines

Lanes do not depend on what ran beside them, so methods of several runs may stand in one table. Runs that differ in
anything but their algorithms are refused.
"""

import csv
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from srl_jax.cli.ending import leave
from srl_jax.cli.progress import results
from srl_jax.job import files as output
from srl_jax.report import data as report


@dataclass(frozen=True)
class Arguments:
    """Which runs, and where the joint figure goes."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path | None = None
    """A PNG of the joint curves."""


def check(directories: tuple[Path, ...]) -> None:
    """Raises ValueError where two runs are not comparable."""
    first, _ = output.read_config(directories[0])
    for directory in directories[1:]:
        other, _ = output.read_config(directory)
        free = ("algos", "more", "devices", "memory_gb")
        changed = [name for name in output.differences(vars(first), vars(other)) if name not in free]
        if changed:
            raise ValueError(f"{directory} differs from {directories[0]} in {', '.join(changed)}: no fair table.")


def join(directories: tuple[Path, ...], into: Path) -> None:
    """Writes one lanes.csv and metrics.csv with the lanes of all runs, numbered anew."""
    lanes: list[dict[str, str]] = []
    with (into / "metrics.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(output.Metrics.HEADER)
        for directory in directories:
            start = len(lanes)
            with (directory / "lanes.csv").open(newline="") as source:
                lanes += [row | {"lane": str(start + int(row["lane"]))} for row in csv.DictReader(source)]
            with (directory / "metrics.csv").open(newline="") as source:
                rows = csv.DictReader(source)
                writer.writerows((r["step"], start + int(r["lane"]), r["metric"], r["value"]) for r in rows)
    with (into / "lanes.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, lanes[0])
        table.writeheader()
        table.writerows(lanes)
    (into / "config.json").write_text(json.dumps(json.loads((directories[0] / "config.json").read_text())))


def main() -> None:
    """Prints the table of methods and the probabilities of improvement."""
    arguments = tyro.cli(Arguments)
    check(arguments.runs)
    with tempfile.TemporaryDirectory() as folder:
        join(arguments.runs, Path(folder))
        data = report.read_metrics(folder)
        summary = report.summarise(data)
        if arguments.out:
            report.save_curves(data, arguments.out)
    console = Console(width=150)
    console.print(results(summary))
    for found in summary["improvement"]:
        console.print(
            f"P({found['x']} > {found['y']}) in {found['score']}: "
            f"{found['probability']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"
        )


if __name__ == "__main__":
    leave(main)
