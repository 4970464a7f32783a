"""The verb ``doctor``: what is installed, which devices there are, how fast they are, how long a run will take."""

import json
import os
import sys
from dataclasses import dataclass
from typing import Any

import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.config import Config

PROGRAM = "srl-jax doctor"


@dataclass(frozen=True)
class Arguments:
    """Look at this machine: what is installed, how fast physics and learning are here, how long make run will take."""

    json: bool = False
    """Print everything as JSON, for programs."""
    repeats: int = 3
    """Measurements of each speed, of which the fastest counts."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, measures and prints; exits as `leave` says, with 0 whatever there is to change."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    if arguments.repeats < 1:
        raise ValueError(f"repeats is {arguments.repeats}: at least 1 is needed.")
    print("Measuring: about a minute, most of it compiling, the first time.", file=sys.stderr, flush=True)
    found = examined(Config(), arguments.repeats)
    if arguments.json:
        print(json.dumps(found, indent=2))
    else:
        print("\n".join(told(found)))
    return 0


def examined(config: Config, repeats: int) -> dict[str, Any]:
    """Everything that the doctor finds out, as plain JSON.

    Args:
        config: of the run whose time is told.
        repeats: measurements of each speed.
    """
    given = os.environ.get("NPROC")
    devices = use_devices(config.devices, solves=False)

    from srl_jax.cli import checkup  # jax starts here

    host = checkup.host()
    variables = {name: value for name, value in host.variables.items() if name != "NPROC" or given is not None}
    host = host._replace(variables=variables)
    found: dict[str, Any] = {"host": host._asdict(), "installed": checkup.installed()}
    found["speed"] = checkup.speeds(host.cores, repeats)
    found["make_run"] = checkup.forecast(config, host.cores, devices, found["speed"])
    return found | {"advice": list(checkup.advice(host, found))}


def told(found: dict[str, Any]) -> list[str]:
    """The same in words."""
    host, speed, run = found["host"], found["speed"], found["make_run"]
    have = [f"{name} {version}" for name, version in found["installed"].items() if version]
    lack = [name for name, version in found["installed"].items() if not version]
    free = "" if host["memory_gib"] is None else f", {host['memory_gib']} GiB of memory free"
    minutes = "" if run["minutes"] is None else f", about {run['minutes']:.0f} minutes"
    set_variables = ", ".join(f"{name}={value}" for name, value in host["variables"].items()) or "none that matters"
    return [
        f"Python {host['python']} on {host['system']}",
        f"Installed: {', '.join(have)}",
        f"Not installed (extras): {', '.join(lack) or 'nothing'}",
        f"Cores: {host['cores']} of {host['machine_cores']}, load {host['load']}{free}",
        f"jax: {host['backend']}, {len(host['devices'])} devices ({', '.join(dict.fromkeys(host['devices']))}), "
        f"{host['threads']} threads in XLA's pool",
        f"Variables: {set_variables}",
        f"Compiled programs are kept in {host['cache']}",
        f"Pictures: {host['opengl'] or 'by NumPy, without OpenGL'}",
        f"sgemm: {speed['sgemm_gflops']:,.0f} GFLOP/s on all cores",
        f"Physics: {speed['physics_steps_per_second_one_device']:,} steps/s on one device, "
        f"C MuJoCo {speed['c_mujoco_steps_per_second']:,} on all cores",
        f"make run: {run['lanes']} lanes of {run['steps']:,} steps, {run['memory_gib']} GiB{minutes}",
        "",
        *(found["advice"] or ["Nothing to change."]),
    ]
