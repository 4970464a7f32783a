"""The verb ``repertoire``: ``srl-jax repertoire --evaluations 200000`` fills a map of gaits."""

import dataclasses
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.cli.signals import StopSignals
from srl_jax.ite.settings import RepertoireSettings, check, read_settings
from srl_jax.job.files import differences

PROGRAM = "srl-jax repertoire"


@dataclass(frozen=True)
class Arguments(RepertoireSettings):
    """Fill a map of gaits by MAP-Elites: for every pattern of foot contacts, the fastest gait that was found."""

    out: str = ""
    """Directory for the results; runs/repertoire-<date> if empty."""
    resume: str = ""
    """Directory of a search to go on with; its settings are kept, but for more evaluations."""
    devices: str = "auto"
    """Devices a batch is laid over: auto (one per core, or all accelerators, as far as they divide it) or a number."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, searches, prints what was found; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments, settings = parse(argv)
    devices = use_devices(arguments.devices, settings.batch)
    if arguments.devices == "auto":
        devices = max(count for count in range(1, devices + 1) if settings.batch % count == 0)

    from srl_jax.cli.repertoire_progress import SearchDisplay
    from srl_jax.job import repertoire as search  # jax is imported here, after the devices are known

    stop = StopSignals()
    with SearchDisplay() as display:
        summary = search.run(
            settings,
            Path(arguments.resume or arguments.out or f"runs/repertoire-{time.strftime('%Y%m%d-%H%M%S')}"),
            devices,
            exact=bool(arguments.out),
            resume=bool(arguments.resume),
            listener=display.show,
            stopped=stop.requested,
        )
    if summary is None:
        print(f"Stopped and saved. Go on with: srl-jax repertoire --resume {display.directory}")
        return 128 + stop.number
    display.closing(summary)
    return 0


def parse(argv: list[str]) -> tuple[Arguments, RepertoireSettings]:
    """The command line, on top of the settings of the search that is resumed, if one is.

    Raises:
        ValueError: a number is out of range, or a resumed search is given other settings than its own.
    """
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    old = None
    if arguments.resume:
        old = read_settings(Path(arguments.resume))
        arguments = tyro.cli(Arguments, args=argv, default=Arguments(**vars(old)), prog=PROGRAM)
    settings = RepertoireSettings(
        **{field.name: getattr(arguments, field.name) for field in dataclasses.fields(RepertoireSettings)}
    )
    check(settings)
    if old is not None:
        changed = [name for name in differences(vars(old), vars(settings)) if name != "evaluations"]
        if changed or arguments.out:
            fields = ", ".join(changed) or "out"
            raise ValueError(f"resume {arguments.resume}: {fields} differ from the search's own; leave them out.")
        if settings.evaluations < old.evaluations:
            raise ValueError(f"evaluations is {settings.evaluations}: the search to resume has {old.evaluations}.")
    return arguments, settings
