"""The verb ``deploy``: a policy walks on the robot itself, over its servos' bus, or on a simulated one."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tyro

from srl_jax import pretrained
from srl_jax.cli import play
from srl_jax.cli.deploy_options import Arguments
from srl_jax.cli.ending import leave
from srl_jax.cli.signals import StopSignals
from srl_jax.env import damage_names
from srl_jax.job.course import ALGOS
from srl_jax.portable import Policy

PROGRAM = "srl-jax deploy"
NONE = "none"
TASK = "x"  # the one for which a robot need not know where it is


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and walks; exits as `leave` says, with 1 where the walk ended before its time."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    _check(arguments)
    repertoire = _repertoire(arguments)
    try:
        from srl_jax.cli import deploy_story
    except ModuleNotFoundError as error:
        if error.name not in ("serial", "dynamixel_sdk"):
            raise
        raise ValueError("deploy needs the extra robot: pip install 'srl-jax[robot]'.") from None
    if arguments.learn:
        from srl_jax.cli import deploy_learn

        return deploy_learn.go(arguments, next(iter(repertoire.values())), _ports(arguments))
    with _ports(arguments) as (bus, imu, simulated):
        return deploy_story.go(arguments, bus, imu, repertoire, simulated, StopSignals().requested)


@contextmanager
def _ports(arguments: Arguments) -> Iterator[tuple]:
    """Names of bus and inertial unit (empty: none), and the simulated robot if it is one."""
    if not arguments.simulate:
        yield arguments.port, "" if arguments.imu == NONE else arguments.imu, None
        return
    from srl_jax.robot.simulate.child import Simulated

    words = ["--damage", arguments.damage, "--strike", "inf" if arguments.strike else "0", "--faults", arguments.faults]
    with Simulated(*words) as simulated:
        yield simulated.bus, simulated.imu, simulated


def _check(arguments: Arguments) -> None:
    """Raises ValueError for what does not fit together."""
    if arguments.simulate == bool(arguments.port):
        raise ValueError(f"port is {arguments.port!r}: give the adapter's, such as /dev/ttyUSB0, or --simulate.")
    if arguments.port and not arguments.imu:
        raise ValueError("imu is missing: give its port, such as /dev/ttyACM0, or none, and tipping is not noticed.")
    if arguments.simulate and arguments.imu:
        raise ValueError(f"imu is {arguments.imu!r}: a simulated robot has its own; leave it out.")
    damage_names.canonical(arguments.damage)
    for name, least, most in (("seconds", 0.05, 86_400.0), ("torque", 0.05, 1.0), ("strike", 0.0, 86_400.0)):
        if not least <= getattr(arguments, name) <= most:
            raise ValueError(f"{name} is {getattr(arguments, name)}: accepted is {least:g} to {most:g}.")
    if Path(arguments.log).is_dir():
        raise ValueError(f"log is {arguments.log}: give a file.")
    _check_learning(arguments)


def _check_learning(arguments: Arguments) -> None:
    """Raises ValueError for what does not fit to learning, or needs it."""
    if not arguments.learn:
        for name in ("behaviour", "odometer", "resume"):
            if value := getattr(arguments, name):
                raise ValueError(f"{name} is {value!r} without --learn: give both, or leave it out.")
        return
    if arguments.algo not in ("", *ALGOS):
        raise ValueError(f"algo is {arguments.algo!r}: what a robot learns by is {' or '.join(ALGOS)}.")
    if arguments.dry_run:
        raise ValueError("dry-run is True: a robot that does not move learns nothing; leave out --learn.")
    if arguments.port and not arguments.odometer:
        raise ValueError(
            "odometer is missing: a reward needs how far the robot has come, which none of its own sensors tells; give "
            "the port of an odometer."
        )
    if arguments.simulate and arguments.odometer:
        raise ValueError(f"odometer is {arguments.odometer!r}: a simulated robot has its own; leave it out.")
    if arguments.behaviour and arguments.policy != Arguments.policy:
        raise ValueError(f"policy is {arguments.policy!r} and behaviour {arguments.behaviour!r}: leave one out.")
    for name, least, most in (("episode", 0.5, 600.0), ("updates", 1, 100), ("seed", 0, 2**31 - 1)):
        if not least <= getattr(arguments, name) <= most:
            raise ValueError(f"{name} is {getattr(arguments, name)}: accepted is {least:g} to {most:g}.")


def _repertoire(arguments: Arguments) -> dict[str, Policy]:
    """Policies by the damage that they are for; first the one that walks first."""
    from srl_jax.robot.policy import checked

    name, first = arguments.behaviour or arguments.policy, damage_names.canonical(arguments.trained_for)
    if name == play.TRIPOD:
        raise ValueError(
            "policy is 'tripod', a script that needs jax: give atlas, or a file of python -m srl_jax.export."
        )
    if name in play.SHIPPED:
        chosen = checked(pretrained.load(name, task=TASK, damage=first))
        there = [own.damage for own in pretrained.names() if (own.name, own.task) == (name, TASK)]
        others = [pretrained.load(name, task=TASK, damage=damage) for damage in there]
    else:
        others = play.policies(name)
        tasks = [policy.about.get("task") for policy in others]
        # Where all are for another task, `checked` says so in a sentence about robots.
        task = TASK if TASK in tasks else str(tasks[0])
        chosen = checked(play.one(others, Path(name), task, first, "" if arguments.learn else arguments.algo))
    found = {first: chosen}
    for policy in others if arguments.switch and not arguments.learn else []:
        if all(policy.about.get(key) == chosen.about.get(key) for key in ("task", "kind", "algo")):
            found.setdefault(policy.about["damage"], policy)
    return found
