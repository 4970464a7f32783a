"""Measurements to where people already look: TensorBoard, Weights & Biases, a wide table. No jax is imported here.

What is sent is read from metrics.csv, which stays the record: a resumed run's logs are those of an uninterrupted one.
"""

import contextlib
from collections.abc import Sequence
from importlib import util
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from srl_jax.job.log_targets import Target
    from srl_jax.job.progress import Progress

By = Literal["method", "lane"]


class Kind(NamedTuple):
    """A word of ``--log``."""

    package: str  # that it needs
    extra: str  # that installs it; csv is Python's own


KINDS = {
    "tensorboard": Kind("tensorboardX", "tensorboard"),
    "wandb": Kind("wandb", "wandb"),
    "csv": Kind("csv", ""),
}


def parse(words: str) -> tuple[str, ...]:
    """The kinds that a comma list names.

    Raises:
        ValueError: an unknown word, or one whose package is not installed.
    """
    found = tuple(dict.fromkeys(word.strip() for word in words.split(",") if word.strip()))
    for word in found:
        if word not in KINDS:
            raise ValueError(f"log is {words!r}: choose from {', '.join(KINDS)}, separated by commas.")
        if util.find_spec(KINDS[word].package) is None:
            raise ValueError(f"log is {words!r}: {word} needs pip install 'srl-jax[{KINDS[word].extra}]'.")
    return found


class Logs:
    """A listener of a run that hands what was measured on to its targets."""

    def __init__(self, kinds: Sequence[str], by: By = "method"):
        """Opens nothing yet: the run's directory is known with its first progress.

        Args:
            kinds: as `parse` gives them.
            by: method, the interquartile mean over its lanes; or every lane.
        """
        self._kinds, self._by = kinds, by
        self._targets: list[Target] = []
        self._directory: Path | None = None
        self._sizes: dict[Path, int] = {}  # of each metrics.csv when it was last read

    def __enter__(self) -> "Logs":
        return self

    def update(self, status: "Progress") -> None:
        """Sends on what has been measured since the last call."""
        if self._directory is None:
            self._directory = status.directory
        self._read(status.directory)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._directory is not None and kind is None:
                self._read(self._directory)  # what the waves of a run measured is joined at its end
        finally:
            with contextlib.ExitStack() as end:
                for target in self._targets:
                    end.callback(target.close)

    def _read(self, directory: Path) -> None:
        # Of a run in waves only lanes are complete before its end; and a run that trains a teacher is another run.
        assert self._directory is not None
        own = directory == self._directory or (self._by == "lane" and directory.name.startswith("wave-"))
        path = directory / "metrics.csv"
        if not self._kinds or not own or not path.exists() or path.stat().st_size == self._sizes.get(path):
            return
        self._sizes[path] = path.stat().st_size
        from srl_jax.job import log_points, log_targets  # which would keep --help waiting
        from srl_jax.report.data import read_metrics

        if not self._targets:
            self._targets = [log_targets.TARGETS[kind](self._directory) for kind in self._kinds]
        points = list(log_points.BY[self._by](read_metrics(directory)))
        for target in self._targets:
            target.write(points)
