"""The progress of a search for a repertoire: the main job's display with other figures."""

from typing import Any

from rich.console import Console
from rich.progress import TextColumn

from srl_jax.cli.progress import Display, peak
from srl_jax.ite.elites import CELLS
from srl_jax.ite.walk import STEPS
from srl_jax.job.repertoire import Status

SECONDS = STEPS / 20.0  # of a walk
FILE_EVERY = 30.0  # s between two lines where there is no terminal


class SearchDisplay(Display):
    """Shows `job.repertoire.Status`: evaluations, rate, filled cells and the best speed so far."""

    def __init__(self, console: Console | None = None):
        super().__init__(console)
        count = TextColumn("{task.completed:,.0f}/{task.total:,.0f} gaits")
        self.bar.columns = (*self.bar.columns[:2], count, *self.bar.columns[3:])
        self._said: tuple[str, float] = ("", 0.0)

    def show(self, status: Status) -> None:
        """Shows the newest status; on a file, a line for every new phase, every half minute, and at the end."""
        self.begin(status.directory)
        figures = f"{status.rate:,.0f} gaits/s  {status.filled:,} cells  best {status.best / SECONDS:.3f} m/s"
        self.bar.update(
            self.task, description=status.phase, completed=status.evaluations, total=status.wanted, rates=figures
        )
        phase, said = self._said
        due = status.phase != phase or status.elapsed >= said + FILE_EVERY or status.evaluations >= status.wanted
        if not self.console.is_terminal and due:
            line = f"{status.phase} {status.evaluations}/{status.wanted} {status.elapsed:.0f} s  {figures}"
            self.console.print(line, soft_wrap=True, highlight=False)
            self.console.file.flush()
            self._said = (status.phase, status.elapsed)

    def closing(self, summary: dict[str, Any]) -> None:
        """What was found, and where the files lie."""
        machine, best = summary["machine"], summary["best_fitness"]
        speed = "no gait stays upright" if best is None else f"best {best:.2f} m in 5 s, {best / SECONDS:.3f} m/s"
        self.console.print(
            f"{summary['filled']:,} of {CELLS:,} cells filled ({summary['coverage']:.0%}), {speed}", highlight=False
        )
        self.console.print(
            f"{summary['evaluations']:,} gaits in {summary['seconds']:.0f} s, "
            f"{machine['evaluations_per_second']:,} gaits/s on {machine['devices']} devices, "
            f"compiled in {machine['compile_seconds']:.0f} s{peak(machine)}",
            soft_wrap=True,
            highlight=False,
        )
        files = "map.npz, map.png, metrics.csv, summary.json"
        self.console.print(f"Files: {self.directory}  ({files})", soft_wrap=True, highlight=False)
