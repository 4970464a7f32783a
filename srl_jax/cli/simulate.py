"""A simulated robot on pseudo-terminals: what ``python -m srl_jax.robot.simulate`` is asked for."""

import json
import sys
import time
from dataclasses import dataclass

import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.env import damage_names
from srl_jax.robot.simulate.line import Line, faults

PROGRAM = "python -m srl_jax.robot.simulate"


@dataclass(frozen=True)
class Arguments:
    """Be a PhantomX: an adapter with 18 AX-12A on one pseudo-terminal, an inertial unit on another, and an odometer on
    a third, in real time, with C MuJoCo behind them. Their names are printed; it serves until it is interrupted."""

    damage: str = damage_names.HEALTHY
    """A name such as leg_rm or tibia_rf:limp+femur_lm, or healthy."""
    strike: float = 0.0
    """Seconds until the damage; 0: the robot has it from the start."""
    faults: str = ""
    """Shares of packets that go wrong, such as drop=.02,corrupt=.01,late=.05."""
    latency: float = 1.0
    """Milliseconds that the adapter keeps an answer back: its latency timer."""
    noise: float = 1.0
    """Of the inertial unit, times what policies were trained with."""
    seed: int = 0
    """Of faults and noise."""
    orders: bool = False
    """Obey lines of the standard input (strike, unplug, right, report), and end with it."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and serves; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    damage, given = damage_names.canonical(arguments.damage), faults(arguments.faults)
    for name in ("strike", "latency", "noise"):
        if not getattr(arguments, name) >= 0.0:
            raise ValueError(f"{name} is {getattr(arguments, name)}: at least 0 is accepted.")
    use_devices("1", solves=False)

    from srl_jax.robot.simulate.body import Body
    from srl_jax.robot.simulate.terminal import Terminal

    first = damage_names.HEALTHY if arguments.strike else damage
    body = Body(first, now=time.monotonic(), seed=arguments.seed, noise=arguments.noise)
    line = Line(body.servos, given, arguments.latency / 1000.0, arguments.seed)
    terminal = Terminal(body, line, damage, arguments.strike or float("inf"))
    print(json.dumps({name: getattr(terminal, name) for name in ("bus", "imu", "odometer")}), flush=True)
    try:
        terminal.serve(sys.stdin.fileno() if arguments.orders else None)
    except KeyboardInterrupt:
        return 128 + 2
    finally:
        terminal.close()
    return 0
