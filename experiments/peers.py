"""This package and its peers, side by side, on the same machine in the same minutes.

    python -m experiments.peers --out peers.json

`physics`: C MuJoCo (`mujoco.rollout`), MJX and the star stepper on one core and on two, and on an accelerator where
there is one. `scaling`: what a lane of DDPG costs in this package's program as lanes grow more.
`job`: ten seeds of DDPG under each of six damages by this package, by the same update under `vmap` over seeds, by SBX
and by Stable-Baselines3, the latter two on the robot as a Gymnasium environment (`pip install -e '.[bench]'`).

Every contender runs in a process of its own that is pinned to its cores; contenders are timed in turn,
round by round, and the median round is reported with its spread, half the distance of the fastest round from the
slowest. Tables are printed as markdown, what they are made of is written as JSON after every section.
"""

import dataclasses
import json
import platform
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import tyro

from experiments.contenders import job, measuring, physics, scaling
from srl_jax import machine
from srl_jax.cli.ending import leave
from srl_jax.config import Config, preset

PEERS = ("sbx-rl", "stable_baselines3", "gymnasium", "torch")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What to compare."""

    sections: tuple[Literal["physics", "scaling", "job"], ...] = ("physics", "scaling", "job")
    repeats: int = 5
    """Rounds in which every contender is timed once."""
    seconds: float = 1.0
    """A timed run takes about as long, at least."""
    preset: Literal["default", "smoke"] = "default"
    """Whose networks, batches and tasks; smoke is small, to see that it works."""
    robots: tuple[int, ...] = (1, 4, 16, 64, 256, 1_024, 4_096)
    """Robots that are stepped at once."""
    accelerator_robots: tuple[int, ...] = (256, 1_024, 4_096, 16_384)
    """The same on an accelerator, where there is one."""
    simulators: tuple[Literal["c", "mjx", "ours"], ...] = ("c", "mjx", "ours")
    """C MuJoCo, MJX, and the star stepper."""
    lanes: tuple[int, ...] = (1, 4, 16, 64, 256, 1_024, 4_096)
    """Lanes in the section on scaling."""
    capacity: int = 1_000
    """Transitions in the replay of each of these lanes: with 50,000, as trained, 4,096 lanes would not fit."""
    contenders: tuple[Literal["ours", "ours_mjx", "vmap", "sbx", "sb3"], ...] = (
        "ours",
        "ours_mjx",
        "vmap",
        "sbx",
        "sb3",
    )
    """Who does the whole job; all of them but ours are libraries' or are written as theirs are."""
    seeds: int = 10
    """Seeds of the whole job."""
    steps: int = 2_000
    """Environment steps of each run that are timed in the midst of learning, the rest being reckoned; of as many as a
    run has (50,000), everybody does the whole job once, which takes hours."""
    cold: bool = True
    """Compile in every process, whatever is cached; off: start as warm as can be."""
    out: str = ""
    """File for everything that was measured (JSON); empty: none is written."""


def about() -> dict[str, Any]:
    """The machine and the versions of all that is compared."""
    info = Path("/proc/cpuinfo")
    models = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
    versions = machine.versions()
    for name in PEERS:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": len(measuring.cores()),
        "pinned": hasattr(measuring.os, "sched_setaffinity"),
        "system": platform.platform(),
        "python": platform.python_version(),
        "energy": measuring.joules() is not None,
        "versions": versions,
    }


def markdown(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (titles, ["---"] * len(titles), *rows))


def compare_physics(arguments: Arguments, note: Callable[[str], None]) -> dict[str, Any]:
    """Prints the section on physics; returns what it is made of."""
    sizes = arguments.repeats, arguments.seconds, arguments.simulators
    found = {"processor": physics.side_by_side(arguments.robots, *sizes, note)}
    if physics.accelerator():
        found["accelerator"] = physics.side_by_side(arguments.accelerator_robots, *sizes, note, accelerator=True)
    for where, results in found.items():
        print(f"\n### Physics, steps/s, on the {where}\n\n{markdown(*physics.rows(results))}")
        watts = physics.per_watt(results)
        print(f"\nSteps/s per watt: {watts}" if watts else "\nThis machine's energy counters cannot be read.")
    return {where: _records(results) for where, results in found.items()}


def compare_scaling(arguments: Arguments, note: Callable[[str], None]) -> dict[str, Any]:
    """Prints the section on scaling; returns what it is made of."""
    base, sizes = preset(arguments.preset), (arguments.repeats, arguments.seconds)
    found = scaling.side_by_side(arguments.lanes, arguments.capacity, base, *sizes, arguments.cold, note)
    print(f"\n### Lanes of DDPG, replays of {arguments.capacity:,}\n\n{markdown(*scaling.rows(found))}")
    print(f"\n{scaling.verdict(found)}")
    return {
        str(devices): [row.result.record() | {"relative": row.relative} for row in several]
        for devices, several in found.items()
    }


def compare_job(arguments: Arguments, note: Callable[[str], None]) -> dict[str, Any]:
    """Prints the section on the whole job; returns what it is made of."""
    config = job_config(arguments)
    lacking = job.missing(arguments.contenders)
    wanted = [name for name in arguments.contenders if name not in lacking]
    found = job.side_by_side(config, arguments.steps, arguments.repeats, wanted, arguments.cold, note)
    print(f"\n### DDPG, {arguments.seeds} seeds x damages of {config.damage}, {config.steps:,} steps each")
    print(f"\n{markdown(*job.rows(found))}" if found else "")
    if lacking:
        print(f"\nNot installed, and so left out: {', '.join(lacking)} (pip install -e '.[bench]').")
    return {
        "config": dataclasses.asdict(config),
        "lacking": lacking,
        "found": [one.result.record() | {"job_seconds": one.seconds, "reckoned": one.reckoned} for one in found],
    }


def job_config(arguments: Arguments) -> Config:
    """The run that everybody does."""
    return dataclasses.replace(preset(arguments.preset), algos="ddpg", seeds=str(arguments.seeds), memory_gb=1e6)


def _records(results: dict[Any, list[measuring.Result]]) -> dict[str, list[dict[str, Any]]]:
    return {str(size): [result.record() for result in row] for size, row in results.items()}


SECTIONS = {"physics": compare_physics, "scaling": compare_scaling, "job": compare_job}


def check(arguments: Arguments) -> None:
    """Raises ValueError where there is nothing to measure."""
    sizes = (*arguments.robots, *arguments.accelerator_robots, *arguments.lanes)
    if arguments.repeats < 1 or arguments.seconds <= 0.0 or min(sizes, default=0) < 1:
        raise ValueError(
            f"repeats is {arguments.repeats}, seconds {arguments.seconds}, robots and lanes {sizes}; "
            "numbers of at least 1 and seconds above 0 are needed."
        )
    train = job_config(arguments).train
    unit = train.environments * train.update_every
    if arguments.seeds < 1 or arguments.steps < unit or arguments.steps % unit:
        raise ValueError(
            f"seeds is {arguments.seeds} and steps {arguments.steps}; at least 1, and a multiple of {unit}, are needed."
        )


def main(arguments: Arguments) -> None:
    """Measures section by section, prints tables, and writes the file anew after each.

    Raises:
        ValueError: there is nothing to measure.
    """
    check(arguments)
    report = {"machine": about(), "arguments": dataclasses.asdict(arguments)}
    versions = ", ".join(f"{name} {version}" for name, version in report["machine"]["versions"].items())
    print(f"{report['machine']['cores']} cores of {report['machine']['processor']}; {versions}")
    for section in arguments.sections:
        report[section] = SECTIONS[section](
            arguments, lambda said, section=section: print(f"{section}: {said}", file=sys.stderr, flush=True)
        )
        if arguments.out:
            Path(arguments.out).write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
