"""The verb ``recover``: one robot walks, loses a leg in mid-stride, finds out and walks on."""

import sys
from dataclasses import dataclass
from typing import Literal

import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave

PROGRAM = "srl-jax recover"


@dataclass(frozen=True)
class Arguments:
    """The whole story for one robot: it walks, the damage strikes, the posterior moves, another policy takes over."""

    atlas: str = ""
    """The file of an atlas (python -m srl_jax.atlas); empty: the one that ships with the package."""
    damage: str = "random"
    """A name such as leg_rm+leg_lf or femur_rf:limp+tibia_lm:weak=0.5; random: one of the atlas' own; held-out: one
    of these that the robot has neither a hypothesis of nor a policy for."""
    strike: float = 2.0
    """Seconds of healthy walking before it."""
    seconds: float = 20.0
    """In all."""
    rule: Literal["greedy", "thompson", "likeliest", "uniform"] = "greedy"
    """How a policy is chosen from the posterior."""
    learn: bool = True
    """Whether it learns for a damage that it has put together itself, by SRL in its own simulation."""
    physics: Literal["c", "mjx"] = "c"
    """The robot's: C MuJoCo at 2 ms, or what the atlas was trained in."""
    friction: float = 0.8
    """Of the floor, as a share of the atlas' own; C MuJoCo only."""
    out: str = ""
    """Directory for a figure and a video beside a robot that knows nothing; empty: none."""
    seed: int = 0
    """Of the robot's sensors and draws."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and tells the story as it happens; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    if not 0.0 <= arguments.strike < arguments.seconds:
        raise ValueError(
            f"strike is {arguments.strike}: it must be at least 0 and less than seconds={arguments.seconds}."
        )
    use_devices("1", solves=False)

    from srl_jax.cli.story import tell  # jax starts here

    tell(**vars(arguments))
    return 0
