"""The tables of a run: its lanes, and every measured number in long form."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from srl_jax.job.files import replaced
from srl_jax.program.lanes import Lane

Row = tuple[int, int, str, float]  # step, lane, metric, value


def write_lanes(directory: Path, lanes: Sequence[Lane]) -> None:
    """lanes.csv: one row per lane."""
    with replaced(directory / "lanes.csv") as file:
        writer = csv.writer(file)
        writer.writerow(("lane", "algo", "seed", "task", "damage", "variant"))
        writer.writerows((lane.index, lane.algo, lane.seed, lane.task, lane.damage, lane.label) for lane in lanes)


class Metrics:
    """metrics.csv: appended to as the run goes, cut back to where a checkpoint left it when the run resumes."""

    HEADER = ("step", "lane", "metric", "value")

    def __init__(self, directory: Path, keep: int | None = None):
        """Opens the file.

        Args:
            directory: of the run.
            keep: bytes of what is there that stay, as `size` said when the checkpoint was saved; None: a new file.

        Raises:
            ValueError: there are fewer.
        """
        self._path = directory / "metrics.csv"
        if keep is None:
            with replaced(self._path) as file:
                csv.writer(file).writerow(self.HEADER)
            return
        if not self._path.exists() or self.size < keep:
            raise ValueError(f"{self._path} is shorter than when its checkpoint was saved: restore it from a copy.")
        with self._path.open("r+b") as file:
            file.truncate(keep)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._path.stat().st_size

    def write(self, rows: Iterable[Row]) -> None:
        """Appends all rows or none, and hands them to the operating system, so that a killed run loses none of them."""
        text = io.StringIO()
        csv.writer(text).writerows((step, lane, name, f"{value:.7g}") for step, lane, name, value in rows)
        left = memoryview(text.getvalue().encode())
        with self._path.open("ab", buffering=0) as file:
            before = file.tell()
            try:
                while left:
                    left = left[file.write(left) :]
            except OSError:
                file.truncate(before)
                raise


def join_metrics(parts: Iterable[tuple[Path, int]], into: Path) -> None:
    """metrics.csv of a run whose lanes were trained in parts, copied row by row.

    Args:
        parts: the directory of each, and what is added to the numbers of its lanes.
        into: where the file goes.
    """
    with replaced(into / "metrics.csv") as file:
        csv.writer(file).writerow(Metrics.HEADER)
        for part, first in parts:
            with (part / "metrics.csv").open(newline="") as rows:
                next(rows)
                file.writelines(_renumbered(rows, first) if first else rows)


def _renumbered(rows: Iterable[str], first: int) -> Iterator[str]:
    for row in rows:
        step, lane, rest = row.split(",", 2)
        yield f"{step},{int(lane) + first},{rest}"
