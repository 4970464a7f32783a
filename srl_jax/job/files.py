"""The directory of a job, and what was asked and on which machine."""

import contextlib
import dataclasses
import errno
import itertools
import json
import platform
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from srl_jax import machine
from srl_jax.agents import registry
from srl_jax.config import Config

HELD = {errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES}
NO_LOCKS = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}


def claim(directory: Path, *, exact: bool) -> Path:
    """Makes the directory of a new job, which no other job can then take for its own; returns it.

    Args:
        directory: where the files are to go.
        exact: it is this directory or none; otherwise a number is appended until the name is free.

    Raises:
        ValueError: `exact`, and there are files in it.
    """
    if exact:
        check_empty(directory)
        directory.mkdir(parents=True, exist_ok=True)
        return directory
    directory.parent.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(1):
        name = directory if number == 1 else directory.with_name(f"{directory.name}-{number}")
        with contextlib.suppress(FileExistsError):
            name.mkdir()
            return name
    raise AssertionError("numbers do not end")


def check_empty(directory: Path) -> None:
    """Raises ValueError where a new job would mix its files with others."""
    if directory.exists() and any(directory.iterdir()):
        raise ValueError(f"out is {directory}: it is not empty; choose another, or go on with --resume {directory}.")


@contextlib.contextmanager
def in_use(directory: Path) -> Iterator[None]:
    """Keeps other processes out of a directory, where the system and its file system have locks.

    Raises:
        ValueError: another process is in it.
    """
    with (directory / ".lock").open("w") as file:
        try:
            import fcntl  # not on Windows

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:
            pass
        except OSError as error:
            if error.errno in HELD:
                said = f"{directory} is in use by another job; wait for it or choose another directory."
                raise ValueError(said) from None
            if error.errno not in NO_LOCKS:
                raise
        yield


@contextlib.contextmanager
def replaced(path: Path, mode: str = "w") -> Iterator[IO[Any]]:
    """A file to write: all of it takes the place of `path` at the end, or nothing does."""
    partial = path.with_suffix(".partial")
    try:
        with partial.open(mode, newline=None if "b" in mode else "") as file:
            yield file
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def write_json(path: Path, value: Any) -> None:
    """Writes all of the file or nothing of it."""
    with replaced(path) as file:
        file.write(json.dumps(value, indent=2, allow_nan=False) + "\n")


# config.json


def write_settings(directory: Path, settings: dict[str, Any], devices: int, from_step: int) -> None:
    """config.json: what was asked, and a part for every process that worked on it; this one's is appended."""
    path = directory / "config.json"
    part = {
        "from_step": from_step,
        "began": datetime.now(UTC).isoformat(timespec="seconds"),
        "devices": devices,
        "machine": platform.machine(),
        "python": platform.python_version(),
        "versions": machine.versions(),
    }
    write_json(path, settings | {"parts": [*(read_parts(directory) if path.exists() else []), part]})


def write_config(directory: Path, config: Config, devices: int, from_step: int = 0) -> None:
    """config.json of a run: every setting, resolved; once a process, with its devices and the step it goes on from."""
    write_settings(directory, {"config": dataclasses.asdict(config)}, devices, from_step)


def read_config(directory: Path) -> tuple[Config, int]:
    """The settings of a run and the number of devices of its last part.

    Raises:
        ValueError: the directory is not a run's, or was written by another version.
    """
    stored, path = read_json(directory, "run"), directory / "config.json"
    with _sentence(path):
        values, devices = stored["config"], int(stored["parts"][-1]["devices"])
    return config_of(values, path), devices


def config_of(stored: dict[str, Any], path: Path) -> Config:
    """A configuration from the plain values that `dataclasses.asdict` made of it.

    An algorithm that ships since then has its defaults: the run knows nothing of it.

    Raises:
        ValueError: the values are those of another version; the message names the `path` that they came from.
    """
    with _sentence(path):
        values = dict(stored)
        for name, kind in _SECTIONS.items():
            if name in values or name not in registry.SHIPPED:
                values[name] = _section(kind, values[name])
        values["more"] = {name: _section(type(registry.settings(name)), x) for name, x in values["more"].items()}
        return Config(**values)


def read_parts(directory: Path) -> list[dict[str, Any]]:
    """The processes that worked on a job, oldest first: from_step, began, devices, machine, python, versions.

    Raises:
        ValueError: the directory is not a job's, or was written by another version.
    """
    stored = read_json(directory, "job")
    with _sentence(directory / "config.json"):
        return list(stored["parts"])


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Names of the fields, sections included, in which two configurations differ."""
    changed = []
    for name, value in old.items():
        if dataclasses.is_dataclass(value):
            inner = differences(vars(value), vars(new[name]))
            changed += [f"{name}.{field}" for field in inner]
        elif value != new[name]:
            changed.append(name)
    return changed


_SECTIONS = {name: type(value) for name, value in vars(Config()).items() if dataclasses.is_dataclass(value)}


def read_json(directory: Path, kind: str = "job") -> dict[str, Any]:
    """config.json as it stands.

    Raises:
        ValueError: there is none, or it is no JSON.
    """
    path = directory / "config.json"
    try:
        with _sentence(path):
            return json.loads(path.read_text())
    except FileNotFoundError:
        raise ValueError(f"{directory} is not the directory of a {kind}: it has no config.json.") from None


@contextlib.contextmanager
def _sentence(path: Path) -> Iterator[None]:
    """Turns what a broken or foreign file causes into one sentence."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path} cannot be read as a configuration of this version: {error}.") from error


def _section(kind: type, values: dict[str, Any]) -> Any:
    return kind(**{key: _tupled(value) for key, value in values.items()})


def _tupled(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
