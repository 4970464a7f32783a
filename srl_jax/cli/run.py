"""The verb ``run``: ``srl-jax run --seeds 10 --task p2p`` trains."""

import dataclasses
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from srl_jax import machine
from srl_jax.agents import registry
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.cli.left import Left
from srl_jax.cli.signals import StopSignals
from srl_jax.config import Config, Preset, preset
from srl_jax.env.anatomy import PHANTOMX
from srl_jax.job import plan
from srl_jax.job.files import differences, read_config
from srl_jax.job.logs import Logs
from srl_jax.job.logs import parse as parse_logs

if TYPE_CHECKING:
    from srl_jax.job.progress import Progress

FIELDS = tuple(field.name for field in dataclasses.fields(Config) if field.name != "more")
OF_THE_MACHINE = ("devices",)  # what a run may go on with on another machine
QUICK = 1_024  # size of the product of matrices that tells how fast this machine is
SHORT = {"--physics": "--env.physics"}  # options that may be given without their section


@dataclass(frozen=True)
class Arguments(Config):
    """Train DDPG and SRL on a damaged robot: every seed and every damage in one compiled program."""

    preset: Preset = "default"
    """Where the other options start from: default (tuned for two cores), paper (its table as printed), robot (one robot
    after its damage: what it senses, an update a step), smoke."""
    out: str = ""
    """Directory for the results; runs/<task>-<date> if empty."""
    resume: str = ""
    """Directory of a run to go on with; its settings are kept, but for devices."""
    log: str = ""
    """Where measurements go besides metrics.csv: any of tensorboard, wandb, csv, separated by commas."""
    log_by: Literal["method", "lane"] = "method"
    """What they are of: method, the interquartile mean over its lanes, or every lane."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, runs, prints the closing table; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments, config = parse(argv)
    directory = Path(arguments.resume or arguments.out or f"runs/{config.task}-{time.strftime('%Y%m%d-%H%M%S')}")
    logs, again = Logs(parse_logs(arguments.log), arguments.log_by), bool(arguments.resume)
    return train(config, directory, exact=bool(arguments.out), resume=again, verb="srl-jax run", logs=logs)[1]


def train(
    config: Config, directory: Path, *, exact: bool, resume: bool, verb: str, logs: Logs | None = None
) -> tuple[Path, int]:
    """Sets jax up and trains, with a display; returns where the files went, and 0 or what a shell makes of the signal.

    Args:
        config: what to do.
        directory: where the files go.
        exact: it is this directory, or another number may be appended where it is taken.
        resume: go on with what is there.
        verb: by which a stopped run is gone on with.
        logs: where measurements go besides the run's own files.
    """
    devices, stop = devices_of(config), StopSignals()
    quiet()

    from srl_jax.cli.progress import Display
    from srl_jax.job.run import run  # jax starts here, after the devices are known
    from srl_jax.job.speed import sgemm_rate
    from srl_jax.sweep.cost import OF_RATES, run_seconds

    speed = OF_RATES._replace(sgemm=sgemm_rate(1, QUICK) / machine.cores())
    left = Left(None if resume else run_seconds(config, devices, speed), config.train.warmup)
    with logs or Logs(()) as told, Display(left=left) as display:

        def listen(status: "Progress") -> None:
            told.update(status)
            display.update(status)

        summary = run(
            config,
            directory,
            devices,
            exact=exact,
            resume=resume,
            listener=listen,
            stopped=stop.requested,
        )
    if summary is None:
        print(f"Stopped and saved. Go on with: {verb} --resume {display.directory}")
        return display.directory, 128 + stop.number
    display.closing(summary)
    return display.directory, 0


def devices_of(config: Config) -> int:
    """Sets jax up for a run, before it starts; returns the number of devices.

    Raises:
        ValueError: the configuration is not a possible one, or wants more devices than there are.
    """
    return use_devices(config.devices, len(plan.make(config).lanes), solves=config.solves)


def quiet() -> None:
    """Orbax logs the traceback of every error that it also raises; that is left out."""
    from absl import logging

    logging.set_verbosity(logging.FATAL)


def parse(argv: list[str]) -> tuple[Arguments, Config]:
    """The command line on top of a preset, or of the run that is resumed, and what it configures.

    Raises:
        ValueError: a resumed run is given settings that differ from its own.
    """
    argv = _spelled_out(argv)
    resume, name = _option(argv, "--resume"), _option(argv, "--preset")
    robot = _option(argv, "--robot") or PHANTOMX.name
    base = read_config(Path(resume))[0] if resume else preset(name or "default", robot)
    values: dict[str, Any] = {name: getattr(base, name) for name in FIELDS}
    values |= {name: base.agent(name) for name in _registered()}
    arguments = tyro.cli(_sections(), args=argv, default=_sections()(**values), prog="srl-jax run")
    if resume:
        changed = differences(values, {key: getattr(arguments, key) for key in values})
        refused = [name for name in changed if name not in OF_THE_MACHINE]
        refused += [name for name in ("out", "preset") if _option(argv, f"--{name}")]
        if refused:
            raise ValueError(
                f"resume {resume}: {', '.join(refused)} differ from the run's own; leave them out, or start a new run."
            )
    used = [name for name in _registered() if name in {part.strip() for part in arguments.algos.split(",")}]
    more = {name: getattr(arguments, name) for name in used}
    return arguments, Config(**{name: getattr(arguments, name) for name in FIELDS}, more=more)


def _registered() -> list[str]:
    """Algorithms from outside the package."""
    return [name for name in registry.names() if name not in registry.SHIPPED]


def _sections() -> type[Arguments]:
    """The arguments, with a section for every algorithm from outside the package."""
    extra = [(name, type(registry.settings(name)), registry.settings(name)) for name in _registered()]
    about = {"__doc__": Arguments.__doc__}
    return dataclasses.make_dataclass("Arguments", extra, bases=(Arguments,), namespace=about, frozen=True)


def _spelled_out(argv: list[str]) -> list[str]:
    """The command line with every option in its section."""
    parts = [word.partition("=") for word in argv]
    return [SHORT.get(name, name) + equals + value for name, equals, value in parts]


def _option(argv: list[str], name: str) -> str:
    """The value of an option that decides what the others default to."""
    for index, word in enumerate(argv):
        if word == name and index + 1 < len(argv):
            return argv[index + 1]
        if word.startswith(name + "="):
            return word[len(name) + 1 :]
    return ""
