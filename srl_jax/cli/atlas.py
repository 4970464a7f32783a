"""The verb ``atlas``: ``srl-jax atlas --damages all`` trains a policy for every damage, before any happens."""

import dataclasses
import shlex
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from srl_jax.cli.ending import leave
from srl_jax.cli.run import OF_THE_MACHINE, devices_of, train
from srl_jax.config import GUIDANCE_WEIGHT, STRIDE_STARTS, Config, preset, taking_over
from srl_jax.job import plan
from srl_jax.job.files import differences, read_config

PROGRAM = "srl-jax atlas"
NAME = "atlas.npz"
PRESETS: tuple[Literal["default", "smoke"], ...] = ("default", "smoke")


@dataclass(frozen=True)
class Arguments:
    """Train a policy for every damage in one program, judge all of them under all damages, and write one file."""

    damages: str = "all"
    """As --damage of a run: names and sets, such as all,triples or losses21+joints. The healthy robot is added."""
    task: Literal["x", "p2p"] = "x"
    """What the policies do."""
    seeds: str = "1"
    """Policies of each damage: a count or a list."""
    steps: int = 150_000
    """Environment steps of each policy."""
    observation: Literal["onboard", "rates"] = "onboard"
    """What the policies see: encoders, gravity and clock; rates: with gyroscope and joint speeds."""
    stride_starts: float = STRIDE_STARTS
    """Share of episodes that start in mid-stride, where the damage has just struck."""
    guidance_weight: float = GUIDANCE_WEIGHT
    """Weight of the tripod's guidance (--srl.guidance-weight)."""
    preset: Literal["default", "smoke"] = "default"
    """smoke: as small as it gets."""
    out: str = ""
    """Directory of the run and the file; runs/atlas-<date> if empty."""
    resume: str = ""
    """Directory to go on with; its settings are kept."""
    devices: str = "auto"
    """Devices the lanes are laid over: auto or a number."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, trains, judges, writes; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments, config = parse(argv)
    directory = Path(arguments.resume or arguments.out or f"runs/atlas-{time.strftime('%Y%m%d-%H%M%S')}")
    if (directory / "summary.json").exists() and arguments.resume:  # trained, but not judged
        devices_of(config)
    else:
        exact, resume = bool(arguments.out), bool(arguments.resume)
        directory, code = train(config, directory, exact=exact, resume=resume, verb=PROGRAM)
        if code:
            return code

    from srl_jax.job import atlas  # jax has been set up

    print(f"Judging {len(plan.make(config).lanes)} policies under every damage.", flush=True)
    made = atlas.from_run(directory, directory / NAME, command=asked(arguments))
    best = made.value.max(axis=0)
    print(f"{directory / NAME}: {len(made.trained_for)} policies, {len(made.damages)} damages.")
    print(f"The best policy for a damage keeps {best.mean():.2f} of the healthy speed, {best.min():.2f} at worst.")
    return 0


def parse(argv: list[str]) -> tuple[Arguments, Config]:
    """The command line, on top of what the resumed atlas was asked for, if one is; and the run that it configures.

    Raises:
        ValueError: a value is impossible, or a resumed atlas is given other settings than its own.
    """
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    if not arguments.resume:
        return arguments, configured(arguments)
    config = read_config(Path(arguments.resume))[0]
    own = replace(of(config, arguments.resume), resume=arguments.resume)
    arguments = tyro.cli(Arguments, args=argv, default=own, prog=PROGRAM)
    changed = [name for name in differences(vars(own), vars(arguments)) if name not in OF_THE_MACHINE]
    if changed:
        raise ValueError(f"resume {own.resume}: {', '.join(changed)} differ from the atlas' own; leave them out.")
    return arguments, replace(config, devices=arguments.devices)


def of(config: Config, directory: str) -> Arguments:
    """What an atlas' run was asked for.

    Raises:
        ValueError: the run is none of an atlas.
    """
    for name in PRESETS:
        arguments = Arguments(
            damages=config.damage,
            task=config.task,  # pyright: ignore[reportArgumentType]
            seeds=config.seeds,
            steps=config.steps,
            observation=config.env.observation,  # pyright: ignore[reportArgumentType]
            stride_starts=config.env.stride_starts,
            guidance_weight=config.srl.guidance_weight[0],
            preset=name,
            devices=config.devices,
        )
        if configured(arguments) == config:
            return arguments
    raise ValueError(f"resume is {directory}: it is no atlas' run; go on with it by srl-jax run --resume {directory}.")


def asked(arguments: Arguments) -> str:
    """The command that makes the same atlas again, wherever its files go."""
    default, words = Arguments(), PROGRAM.split()
    for field in dataclasses.fields(Arguments):
        value = getattr(arguments, field.name)
        if value != getattr(default, field.name) and field.name not in ("out", "resume", *OF_THE_MACHINE):
            words += [f"--{field.name.replace('_', '-')}", str(value)]
    return shlex.join(words)


def configured(arguments: Arguments) -> Config:
    """The run that trains an atlas' policies.

    Raises:
        ValueError: damages, seeds or steps are none.
    """
    how = (arguments.task, arguments.observation, arguments.stride_starts, arguments.guidance_weight)
    base = taking_over(preset(arguments.preset), *how)
    unit = base.train.evaluate_every
    every = max(unit, arguments.steps // 10 // unit * unit)
    train = replace(base.train, evaluate_every=every, checkpoint_every=every)
    config = replace(
        base,
        seeds=arguments.seeds,
        steps=arguments.steps,
        damage=arguments.damages,
        devices=arguments.devices,
        train=train,
    )
    names = plan.parse_damages(config)
    return config if "healthy" in names else replace(config, damage=f"healthy,{arguments.damages}")
