"""The animation of the README: a healthy robot, and three that lose a leg and go on by the old gait, by DDPG, by SRL.

    python -m srl_jax.run --task x --damage leg_rm --seeds 1 --steps 10000 --out runs/walking
    python -m experiments.walking runs/walking --path docs/walking.webp

10,000 steps are eight minutes of robot time. All four walk by the tripod until the leg is lost; DDPG's and SRL's robots
then stand for a second, and go on by what the run has learned.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.demo.check import STAND, Act, Walker
from srl_jax.env import gait
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.job import export
from srl_jax.portable import Policy
from srl_jax.report.paint import paint, visible_model
from srl_jax.report.video import caption

BEFORE, AFTER = 30, 120  # control steps before the loss, and after it


@dataclass(frozen=True)
class Args:
    """Draws four robots side by side."""

    run: Annotated[Path, tyro.conf.Positional]
    """Of DDPG and SRL on task x, one damage."""
    path: Path = Path("docs/walking.webp")
    """A .webp or .gif."""
    seed: int = 0
    every: int = 2
    """Control steps from picture to picture."""
    width: int = 400
    height: int = 240
    quality: int = 55
    """Of the pictures in a .webp."""


def main(args: Args) -> None:
    """Writes the animation.

    Raises:
        ValueError: the run is not finished, or not of DDPG and SRL on task x.
    """
    use_devices("1", solves=False)
    policies = {own.about["algo"]: own for own in export.from_run(args.run, seed=args.seed)}
    if not {"ddpg", "srl"} <= policies.keys() or policies["srl"].about["task"] != "x":
        raise ValueError(f"run is {args.run}: it must be of --algos ddpg,srl on --task x.")
    tripod = jax.jit(lambda seen: gait.act(gait.load(), seen))
    old: Act = lambda seen: np.asarray(tripod(seen))  # noqa: E731
    damage = policies["srl"].about["damage"]
    robots = [
        ("healthy, its gait", HEALTHY, None),
        (f"without {damage}: the same gait", damage, None),
        ("what DDPG learned", damage, policies["ddpg"]),
        ("what SRL learned", damage, policies["srl"]),
    ]
    about = policies["srl"].about
    films = [_film(args, said, broken, about, old, learned) for said, broken, learned in robots]
    frames = [np.block([[[a], [b]], [[c], [d]]]) for a, b, c, d in zip(*films, strict=True)]
    _write(args, frames)
    print(f"{args.path}: {args.path.stat().st_size / 1e6:.2f} MB")


def _film(args: Args, said: str, damage: str, about: dict, old: Act, learned: Policy | None) -> Iterator[np.ndarray]:
    """The pictures of one robot, each with a line below."""
    walker, poses = Walker(damage, "x", about["kind"], about["clock_hz"]), []
    for t in range(BEFORE + AFTER):
        walker.broken = int(t >= BEFORE)
        standing = learned is not None and BEFORE <= t < BEFORE + STAND
        if t == BEFORE + STAND and learned:
            walker.phase, walker.heading = 0.0, walker.ahead
        walker.step(None if standing else learned if learned and t >= BEFORE else old)
        poses.append(walker.data.qpos.copy())
    size = (args.width, args.height)
    shown = range(0, len(poses), args.every)
    parts = ((HEALTHY, [t for t in shown if t < BEFORE]), (damage, [t for t in shown if t >= BEFORE]))
    pictures = (
        picture
        for name, steps in parts
        for picture in paint(visible_model(name), np.array([poses[t] for t in steps]), None, size=size)
    )
    for picture, t in zip(pictures, shown, strict=True):
        come = f"{poses[t][0] - poses[BEFORE][0]:.2f} m since" if t >= BEFORE else f"{t / CONTROL_HZ:.1f} s"
        yield np.concatenate([picture, caption(said, come, args.width)])


def _write(args: Args, frames: list[np.ndarray]) -> None:
    from PIL import Image

    first, *others = [Image.fromarray(frame) for frame in frames]
    pace = round(1000 * args.every / CONTROL_HZ)
    args.path.parent.mkdir(parents=True, exist_ok=True)
    first.save(args.path, save_all=True, append_images=others, duration=pace, loop=0, quality=args.quality, method=4)


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
