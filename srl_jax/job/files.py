"""The files of a run: what was asked, the lane table, and every measured number in long form."""

import contextlib
import csv
import dataclasses
import fcntl
import json
import platform
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from srl_jax.config import Config
from srl_jax.program.lanes import Lane

PACKAGES = (
    "srl-jax",
    "jax",
    "jaxlib",
    "mujoco",
    "mujoco-mjx",
    "flax",
    "optax",
    "distrax",
    "orbax-checkpoint",
)
Row = tuple[int, int, str, float]  # step, lane, metric, value


def write_json(path: Path, value: Any) -> None:
    """Writes all of the file or nothing of it."""
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n")
    partial.replace(path)


def write_config(directory: Path, config: Config, devices: int) -> None:
    """config.json: every setting, resolved, with versions and the machine."""
    versions = {name: metadata.version(name) for name in PACKAGES if name in _installed()}
    machine = {"python": platform.python_version(), "machine": platform.machine(), "devices": devices}
    write_json(directory / "config.json", {"config": dataclasses.asdict(config), "versions": versions} | machine)


def _installed() -> set[str]:
    return {dist.metadata["Name"].replace("_", "-").lower() for dist in metadata.distributions()}


def read_config(directory: Path) -> tuple[Config, int]:
    """The settings of a run and its number of devices.

    Raises:
        ValueError: the directory is not a run's, or was written by another version.
    """
    path = directory / "config.json"
    try:
        stored = json.loads(path.read_text())
        values = dict(stored["config"])
        for name, kind in _SECTIONS.items():
            values[name] = kind(**{key: _tupled(value) for key, value in values[name].items()})
        return Config(**values), int(stored["devices"])
    except FileNotFoundError:
        raise ValueError(f"{directory} is not the directory of a run: it has no config.json.") from None
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} cannot be read as a configuration of this version: {error}.") from error


_SECTIONS = {name: type(value) for name, value in vars(Config()).items() if dataclasses.is_dataclass(value)}


def _tupled(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def write_lanes(directory: Path, lanes: list[Lane]) -> None:
    """lanes.csv: one row per lane."""
    with (directory / "lanes.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("lane", "algo", "seed", "task", "damage", "variant"))
        writer.writerows((lane.index, lane.algo, lane.seed, lane.task, lane.damage, lane.label) for lane in lanes)


class Metrics:
    """metrics.csv: appended to as the run goes, cut back to a checkpoint's step when it resumes."""

    HEADER = ("step", "lane", "metric", "value")

    def __init__(self, directory: Path, keep_until: int | None = None):
        """Opens the file; rows after step `keep_until` are dropped, all of them if it is None."""
        self._path = directory / "metrics.csv"
        kept = [] if keep_until is None or not self._path.exists() else self._rows_until(keep_until)
        partial = self._path.with_suffix(".partial")
        with partial.open("w", newline="") as file:
            csv.writer(file).writerows([self.HEADER, *kept])
        partial.replace(self._path)

    def _rows_until(self, step: int) -> list[list[str]]:
        with self._path.open(newline="") as file:
            rows = [row for row in csv.reader(file) if len(row) == 4 and row[0].isdigit()]
        return [row for row in rows if int(row[0]) <= step]

    def write(self, rows: Iterable[Row]) -> None:
        """Appends rows and hands them to the operating system, so that a killed run loses none of them."""
        with self._path.open("a", newline="") as file:
            csv.writer(file).writerows((step, lane, name, f"{value:.7g}") for step, lane, name, value in rows)


@contextlib.contextmanager
def in_use(directory: Path) -> Iterator[None]:
    """Keeps other processes out of a directory.

    Raises:
        ValueError: another process is in it.
    """
    with (directory / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            said = f"{directory} is in use by another run; wait for it or choose another directory."
            raise ValueError(said) from None
        yield
