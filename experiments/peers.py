"""This package and its peers, side by side, on the same machine in the same minutes.

    python -m experiments.peers --sections physics --out peers.json

`physics`: C MuJoCo (`mujoco.rollout`), MJX and the star stepper on one core and on two, and on an accelerator where
there is one. Every contender runs in a process of its own that is pinned to its cores; contenders are timed in turn,
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

from experiments.contenders import measuring, physics
from srl_jax import machine
from srl_jax.cli.ending import leave

PEERS = ("sbx-rl", "stable_baselines3", "gymnasium", "torch")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What to compare."""

    sections: tuple[Literal["physics"], ...] = ("physics",)
    repeats: int = 5
    """Rounds in which every contender is timed once."""
    seconds: float = 1.0
    """A timed run of physics takes about as long, at least."""
    robots: tuple[int, ...] = (1, 4, 16, 64, 256, 1_024, 4_096)
    """Robots that are stepped at once."""
    accelerator_robots: tuple[int, ...] = (256, 1_024, 4_096, 16_384)
    """The same on an accelerator, where there is one."""
    simulators: tuple[Literal["c", "mjx", "ours"], ...] = ("c", "mjx", "ours")
    """C MuJoCo, MJX, and the star stepper."""
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


def _records(results: dict[Any, list[measuring.Result]]) -> dict[str, list[dict[str, Any]]]:
    return {str(size): [result.record() for result in row] for size, row in results.items()}


SECTIONS = {"physics": compare_physics}


def check(arguments: Arguments) -> None:
    """Raises ValueError where there is nothing to measure."""
    sizes = (*arguments.robots, *arguments.accelerator_robots)
    if arguments.repeats < 1 or arguments.seconds <= 0.0 or min(sizes, default=1) < 1:
        raise ValueError(
            f"repeats is {arguments.repeats}, seconds {arguments.seconds} and robots {sizes}; "
            "repeats and robots of at least 1 and seconds above 0 are needed."
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
