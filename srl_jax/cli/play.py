"""The verb ``play``: one policy on a robot that is damaged in mid-stride, as a video or in MuJoCo's viewer."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from srl_jax import portable, pretrained
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.cli.run import quiet
from srl_jax.env import damage_names
from srl_jax.env.interface import CONTROL_HZ
from srl_jax.portable import Policy

PROGRAM = "srl-jax play"
TRIPOD, SHIPPED = "tripod", ("atlas", "srl", "ddpg")


@dataclass(frozen=True)
class Arguments:
    """Show one policy in C MuJoCo: pi_B walks the healthy robot, its damage strikes, and the policy walks on."""

    damage: str = "leg_rm"
    """A name such as leg_rm or tibia_rf:limp+femur_lm, or healthy."""
    task: Literal["x", "xy", "p2p"] = "x"
    """x: straight ahead; xy: away; p2p: to one goal after the other."""
    policy: str = "atlas"
    """atlas, srl or ddpg (which ship, for x and p2p), tripod (pi_B goes on), the directory of a finished run, or a file
    of python -m srl_jax.export (.npz, .json)."""
    algo: str = ""
    """Of a run or file that has several; empty: srl where there is one."""
    strike: float = 3.0
    """Seconds of healthy walking before the damage; 0: the policy starts from the stance."""
    seconds: float = 15.0
    """In all."""
    view: bool = False
    """Show it in MuJoCo's viewer, in real time, instead of writing a video."""
    out: str = "play.mp4"
    """The video."""
    seed: int = 0
    """Of the start and the goals."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and shows the walk; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    damage, out = damage_names.canonical(arguments.damage), Path(arguments.out)
    strike, seconds = arguments.strike, arguments.seconds
    if not 0.0 <= strike <= seconds - 1.0 / CONTROL_HZ < math.inf:
        raise ValueError(
            f"strike is {strike}: it must be at least 0, and a control step ({1.0 / CONTROL_HZ} s) less than "
            f"seconds={seconds}."
        )
    if not arguments.view and (out.suffix != ".mp4" or out.is_dir()):
        raise ValueError(f"out is {out}: give a file that ends in .mp4.")
    use_devices("1", solves=False)

    from srl_jax.report.video import save_video  # jax starts here
    from srl_jax.show import film, viewer, walker
    from srl_jax.show.walk import Walk

    if arguments.policy == TRIPOD:
        who = walker.tripod(arguments.task)
    else:
        who = walker.by_policy(chosen(arguments, damage), arguments.policy if arguments.policy in SHIPPED else "")
    walk, steps = Walk(who, damage, round(strike * CONTROL_HZ), arguments.seed), round(seconds * CONTROL_HZ)
    moments = list(viewer.view(walk, steps) if arguments.view else walk.until(steps))
    for line in film.told(moments, arguments.task):
        print(line)
    if not arguments.view:
        save_video(out, film.frames(moments, arguments.task))
        print(f"Video: {out}")
    return 0


def chosen(arguments: Arguments, damage: str) -> Policy:
    """The policy that is asked for.

    Raises:
        ValueError: there is none of that name, or none for this task, damage or algorithm.
    """
    name, task = arguments.policy, arguments.task
    if name in SHIPPED:
        return pretrained.load(name, task=task, damage=damage)
    return one(policies(name), Path(name), task, damage, arguments.algo)


def policies(name: str) -> list[Policy]:
    """All in the directory of a finished run, or in a file.

    Raises:
        ValueError: there is none of that name, or it holds no policies.
    """
    source = Path(name)
    if source.is_dir():
        quiet()
        from srl_jax.job import export

        return export.from_run(source)
    if source.suffix in (".npz", ".json"):
        return portable.load(source)
    raise ValueError(
        f"policy is {name!r}: give {', '.join((TRIPOD, *SHIPPED))}, the directory of a finished run, or a file of "
        "python -m srl_jax.export that ends in .npz or .json."
    )


def one(found: list[Policy], source: Path, task: str, damage: str, algo: str) -> Policy:
    """That for a task, a damage and an algorithm; of several algorithms srl where none is named.

    Raises:
        ValueError: there is none.
    """
    tasks = dict.fromkeys(str(policy.about.get("task")) for policy in found)
    if task not in tasks:
        raise ValueError(f"task is {task}: {source} was trained for {', '.join(tasks)}.")
    own = portable.pick([policy for policy in found if policy.about["task"] == task], (damage,), str(source))
    algos: dict[str, Policy] = {}
    for policy in own:
        algos.setdefault(policy.about["algo"], policy)
    wanted = algo or ("srl" if "srl" in algos else next(iter(algos)))
    if wanted not in algos:
        raise ValueError(f"algo is {algo!r}: {source} has {', '.join(algos)}.")
    return algos[wanted]
