"""The progress of a run on a terminal, or as plain lines in a file, and the table at its end."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from srl_jax.cli.left import Left, said
from srl_jax.report.table import format_table

if TYPE_CHECKING:
    from srl_jax.job.progress import Progress as Status


class Terminal(Console):
    """A console that leaves a closed pipe to the command, whose exit code it decides."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


class Display:
    """Shows `loop.Progress`: elapsed and remaining time, rates, and the latest success or return per algorithm."""

    directory: Path  # where the job's files go, known once it has begun

    def __init__(self, console: Console | None = None, left: Left | None = None):
        """Shows nothing yet.

        Args:
            console: where to; None: standard output.
            left: knows how long the run will take, from its beginning; None: its pace must show.
        """
        usual = Terminal() if sys.stdout.isatty() else Terminal(width=140)  # a file has no width
        self.console = console or usual
        self._shown = ("", "")
        self._left = left or Left()
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            TextColumn("{task.fields[rates]}"),
            console=self.console,
            disable=not self.console.is_terminal,
        )
        self.task = self.bar.add_task("starting", total=1, left="", rates="")
        self._begun = False

    def __enter__(self) -> "Display":
        return self

    def begin(self, directory: Path) -> None:
        """Says once where results go; not before there is a status to show, since the input may yet be refused."""
        if not self._begun:
            self._begun, self.directory = True, directory
            self.console.print(f"Results go to {directory}", soft_wrap=True, highlight=False)
            self.bar.start()

    def __exit__(self, *exception: object) -> None:
        self.bar.stop()

    def update(self, status: "Status") -> None:
        """Shows the newest status; on a file, one line whenever something was evaluated."""
        self.begin(status.directory)
        if status.note:
            self.console.print(status.note, soft_wrap=True, highlight=False)
        rates = f"{status.environment_rate:,.0f} env steps/s  {status.update_rate:,.0f} updates/s  {latest(status)}"
        left, phase = said(self._left.seconds(status)), status.phase
        self.bar.update(self.task, description=phase, completed=status.step, total=status.steps, left=left, rates=rates)
        shown = (phase, latest(status))
        if not self.console.is_terminal and shown != self._shown:
            line = f"{phase} {status.step}/{status.steps} {status.elapsed:.0f} s {left} {rates}"
            self.console.print(line, soft_wrap=True, highlight=False)
            self.console.file.flush()
            self._shown = shown

    def closing(self, summary: dict[str, Any]) -> None:
        """The table of results, and where the files lie."""
        self.console.print(results(summary))
        machine = summary["machine"]
        self.console.print(
            f"{machine['lanes']} lanes, {machine['training_seconds']:.0f} s of training, "
            f"{machine['environment_steps_per_second']:,} env steps/s, {machine['updates_per_second']:,} updates/s, "
            f"compiled in {machine['compile_seconds']:.0f} s{peak(machine)}"
        )
        for lane in summary.get("nonfinite_lanes", []):
            name = f"{lane['algo']} {lane['variant']} seed {lane['seed']} {lane['damage']}"
            where = f"step {lane['step']} ({', '.join(lane['measured'])})"
            self.console.print(f"Lane {lane['lane']} ({name}) was not finite at {where}: that counts as failed.")
        self.console.print(
            f"Files: {self.directory}  (report.html, curves.png, summary.json, metrics.csv)", soft_wrap=True
        )


def peak(machine: Mapping[str, Any]) -> str:
    """The memory that a job needed, where the system says so."""
    used = machine["peak_memory_gib"]
    return "" if used is None else f", peak {used} GiB"


def results(summary: Mapping[str, Any]) -> Table:
    """The table of methods of a summary."""
    header, *rows = format_table(summary)
    table = Table(*header, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*row)
    return table


def latest(status: "Status") -> str:
    """The newest evaluation, such as ``srl .83 (return 41)``."""
    return "  ".join(
        f"{algo} {values.get('success', float('nan')):.2f} (return {values.get('return', float('nan')):.1f})"
        for algo, values in status.latest.items()
    )
