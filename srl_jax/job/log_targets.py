"""Where measurements can go besides metrics.csv; each is told all of a run, and takes what it has not got yet."""

import csv
import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from srl_jax.job.files import replaced, write_json
from srl_jax.report.files import read_settings
from srl_jax.statistics import FloatArray

STEP = "environment_step"  # W&B's axis


class Points(NamedTuple):
    """One metric of one method or lane, so far."""

    name: str  # of the method or lane
    metric: str
    steps: FloatArray  # [T] environment steps of a lane, increasing
    values: FloatArray  # [T]


class Target(Protocol):
    """Something that keeps measurements; it is told all of them every time, and takes what is new."""

    def write(self, points: Sequence[Points]) -> None:
        """Takes what it has not got yet."""
        ...

    def close(self) -> None:
        """Ends it; all is kept then."""
        ...


class Sent:
    """What has gone out: the last step of each metric of each name."""

    def __init__(self, last: dict[str, float] | None = None):
        self.last = dict(last or {})

    def new(self, points: Sequence[Points]) -> Iterator[tuple[float, str, str, float]]:
        """(step, name, metric, value) of what is new, by rising step."""
        found = []
        for one in points:
            key = f"{one.name}/{one.metric}"
            before = self.last.get(key, -1.0)
            pairs = zip(one.steps.tolist(), one.values.tolist(), strict=True)
            found += [(step, one.name, one.metric, value) for step, value in pairs if step > before]
            if len(one.steps):
                self.last[key] = max(before, float(one.steps[-1]))
        yield from sorted(found, key=lambda row: row[:3])


class TensorBoard:
    """``tensorboard/`` in the run's directory, a curve for each name; begun anew by every process of a run."""

    def __init__(self, directory: Path):
        self._directory, self._sent, self._writers = directory / "tensorboard", Sent(), {}
        shutil.rmtree(self._directory, ignore_errors=True)

    def write(self, points: Sequence[Points]) -> None:
        """Adds what is new as scalars, and hands it to the operating system."""
        for step, name, metric, value in self._sent.new(points):
            self._writer(name).add_scalar(metric, value, int(step))
        for writer in self._writers.values():
            writer.flush()

    def _writer(self, name: str) -> Any:
        if name not in self._writers:
            import tensorboardX  # pyright: ignore[reportMissingImports]

            folder = self._directory / re.sub(r"[^\w.=+-]+", "_", name)
            self._writers[name] = tensorboardX.SummaryWriter(str(folder))
        return self._writers[name]

    def close(self) -> None:
        """Ends the files."""
        for writer in self._writers.values():
            writer.close()


class WandB:
    """One run of Weights & Biases, whose files lie in ``wandb/``; a resumed job goes on with it.

    `WANDB_MODE`, `WANDB_PROJECT` and W&B's other variables hold.
    """

    def __init__(self, directory: Path):
        """Raises ValueError where W&B refuses, such as without a key and not offline."""
        import wandb  # pyright: ignore[reportMissingImports]

        self._path = directory / "wandb.json"
        stored = json.loads(self._path.read_text()) if self._path.exists() else {"id": None, "sent": {}}
        self._sent = Sent(stored["sent"])
        try:
            self._run = wandb.init(
                dir=str(directory),
                project=None if "WANDB_PROJECT" in os.environ else "srl_jax",
                id=stored["id"],
                name=directory.name,
                resume="allow",
                config=read_settings(directory),
            )
        except wandb.Error as error:
            raise ValueError(f"log is wandb: {error}") from None
        self._run.define_metric(STEP)
        self._run.define_metric("*", step_metric=STEP)

    def write(self, points: Sequence[Points]) -> None:
        """Logs what is new, all of one step together."""
        rows: dict[float, dict[str, float]] = {}
        for step, name, metric, value in self._sent.new(points):
            rows.setdefault(step, {})[f"{name}/{metric}"] = value
        for step, values in rows.items():
            self._run.log({STEP: int(step), **values})
        write_json(self._path, {"id": self._run.id, "sent": self._sent.last})

    def close(self) -> None:
        """Ends the run."""
        self._run.finish()


class Wide:
    """``progress.csv``: a row for every step and name, a column for every metric, empty where nothing was measured."""

    def __init__(self, directory: Path):
        self._path = directory / "progress.csv"
        self._rows: dict[tuple[float, str], dict[str, float]] = {}

    def write(self, points: Sequence[Points]) -> None:
        """Writes the whole table, since a new metric is a new column."""
        for step, name, metric, value in Sent().new(points):
            self._rows.setdefault((step, name), {})[metric] = value
        metrics = sorted({metric for row in self._rows.values() for metric in row})
        with replaced(self._path) as file:
            writer = csv.DictWriter(file, ("step", "name", *metrics))
            writer.writeheader()
            for step, name in sorted(self._rows):
                written = {metric: f"{value:.7g}" for metric, value in self._rows[step, name].items()}
                writer.writerow({"step": int(step), "name": name, **written})

    def close(self) -> None:
        """Nothing is open."""


TARGETS = {"tensorboard": TensorBoard, "wandb": WandB, "csv": Wide}
