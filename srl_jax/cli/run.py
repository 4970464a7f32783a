"""The command line: ``python -m srl_jax.run --seeds 10 --task p2p``. The only module that prints."""

import dataclasses
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import tyro

from srl_jax.config import Config, preset

EXIT_USAGE = 2


@dataclass(frozen=True)
class Arguments(Config):
    """Train DDPG and SRL on a damaged hexapod: every seed and every damage in one compiled program."""

    preset: Literal["default", "paper", "smoke"] = "default"
    """Where the other options start from: default (tuned for two cores), paper (its table as printed), smoke."""
    out: str = ""
    """Directory for the results; runs/<task>-<date> if empty."""
    resume: str = ""
    """Directory of a run to go on with; its settings are kept."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, runs, prints the closing table; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def leave(program: Callable[..., int | None], *arguments: Any) -> NoReturn:
    """Exits with what a program of these arguments returns; with 2, after one sentence, where its input was bad."""
    try:
        sys.exit(program(*arguments))
    except ValueError as error:
        print(f"srl_jax: {error}", file=sys.stderr)
    except OSError as error:
        reason = f"{error.strerror or error}: {error.filename or 'while writing results'}"
        print(f"srl_jax: {reason}.", file=sys.stderr)
    sys.exit(EXIT_USAGE)


def _main(argv: list[str]) -> int:
    arguments = parse(argv)
    config = Config(**{field.name: getattr(arguments, field.name) for field in dataclasses.fields(Config)})
    devices = use_devices(config.devices)
    directory = Path(arguments.resume or arguments.out or f"runs/{config.task}-{time.strftime('%Y%m%d-%H%M%S')}")

    from absl import logging

    from srl_jax import loop  # jax is imported here, after the devices are known

    logging.set_verbosity(logging.FATAL)  # Orbax logs the traceback of every error that it also raises

    if arguments.resume:
        devices = check_devices(directory, devices)
    from srl_jax.cli.progress import Display

    stop = StopSignals()
    with Display(directory) as display:
        summary = loop.run(
            config,
            directory,
            devices,
            resume=bool(arguments.resume),
            listener=display.update,
            stopped=stop.requested,
        )
    if summary is None:
        print(f"Stopped and saved. Go on with: python -m srl_jax.run --resume {directory}")
        return 128 + stop.number
    display.closing(summary)
    return 0


def parse(argv: list[str]) -> Arguments:
    """The command line on top of a preset, or of the run that is resumed.

    Raises:
        ValueError: a resumed run is given settings that differ from its own.
    """
    resume, name = _option(argv, "--resume"), _option(argv, "--preset")
    if resume:
        from srl_jax.job.files import read_config

        base, _ = read_config(Path(resume))
    else:
        base = preset(name or "default")
    values = {field.name: getattr(base, field.name) for field in dataclasses.fields(Config)}
    default = Arguments(**values)
    arguments = tyro.cli(Arguments, args=argv, default=default, prog="python -m srl_jax.run")
    if resume:
        changed = differences(values, {key: getattr(arguments, key) for key in values})
        if changed or arguments.out:
            fields = ", ".join(changed) or "out"
            raise ValueError(
                f"resume {resume}: {fields} differ from the run's own; leave them out, or start a new run."
            )
    return arguments


def _option(argv: list[str], name: str) -> str:
    """The value of an option that decides what the others default to."""
    for index, word in enumerate(argv):
        if word == name and index + 1 < len(argv):
            return argv[index + 1]
        if word.startswith(name + "="):
            return word[len(name) + 1 :]
    return ""


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


def use_devices(wanted: str) -> int:
    """Sets jax up for the devices, before it is imported; returns how many there are.

    On a CPU: one XLA device per core. Its thread pool must be larger than the number of devices, or they deadlock.

    Raises:
        ValueError: `devices` is neither auto nor a positive number, or more than there are.
    """
    if wanted != "auto" and not (wanted.isdigit() and int(wanted) > 0):
        raise ValueError(f"devices is {wanted!r}: give auto or a positive number.")
    cores = len(os.sched_getaffinity(0))
    count = cores if wanted == "auto" else int(wanted)
    if count > 4 * cores:
        raise ValueError(f"devices is {count}: this machine has {cores} cores.")
    os.environ.setdefault("NPROC", str(2 * max(count, cores)))
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "srl_jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
    import jax

    jax.config.update("jax_num_cpu_devices", count)
    if jax.default_backend() != "cpu":
        found = len(jax.devices())
        if wanted != "auto" and count > found:
            raise ValueError(f"devices is {count}: this machine has {found} {jax.default_backend()} devices.")
        count = found if wanted == "auto" else count
    return count


def check_devices(directory: Path, devices: int) -> int:
    """The number of devices of the run that is resumed, on which its lanes lie.

    Raises:
        ValueError: this machine offers another number.
    """
    from srl_jax.job.files import read_config

    _, stored = read_config(directory)
    if stored != devices:
        raise ValueError(f"resume {directory}: it ran on {stored} devices, here are {devices}.")
    return stored


class StopSignals:
    """Remembers the first SIGINT or SIGTERM, so that the run can save before it ends; a second one ends it at once."""

    def __init__(self) -> None:
        self.number = 0
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._remember)

    def _remember(self, number: int, frame: Any) -> None:
        self.number = number
        signal.signal(number, signal.SIG_DFL)

    def requested(self) -> bool:
        """Whether a signal has come."""
        return self.number != 0


if __name__ == "__main__":
    main()
