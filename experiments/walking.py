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

import numpy as np
import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.demo.check import STAND
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.job import export
from srl_jax.report.video import caption
from srl_jax.show import film
from srl_jax.show.walk import Moment, Walk
from srl_jax.show.walker import by_policy, tripod

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
    damage, (ddpg, srl) = policies["srl"].about["damage"], (by_policy(policies[algo]) for algo in ("ddpg", "srl"))
    old = tripod("x", srl.clock_hz, srl.kind)
    walks = [
        ("healthy, its gait", Walk(old, HEALTHY, BEFORE)),
        (f"without {damage}: the same gait", Walk(old, damage, BEFORE)),
        ("what DDPG learned", Walk(ddpg, damage, BEFORE, rest=STAND)),
        ("what SRL learned", Walk(srl, damage, BEFORE, rest=STAND)),
    ]
    films = [_film(args, said, list(walk.until(BEFORE + AFTER))) for said, walk in walks]
    _write(args, [np.block([[[a], [b]], [[c], [d]]]) for a, b, c, d in zip(*films, strict=True)])
    print(f"{args.path}: {args.path.stat().st_size / 1e6:.2f} MB")


def _film(args: Args, said: str, moments: list[Moment]) -> Iterator[np.ndarray]:
    """The pictures of one robot, each with a line below; one that has fallen stays as it lies."""
    moments += moments[-1:] * (BEFORE + AFTER - len(moments))
    shown = range(0, len(moments), args.every)
    pictures = film.drawn([moments[t] for t in shown], "auto", (args.width, args.height))
    for picture, t in zip(pictures, shown, strict=True):
        come = (
            f"{moments[t].qpos[0] - moments[BEFORE].qpos[0]:.2f} m since" if t >= BEFORE else f"{t / CONTROL_HZ:.1f} s"
        )
        yield np.concatenate([picture, caption(said, come, args.width)])


def _write(args: Args, frames: list[np.ndarray]) -> None:
    from PIL import Image

    first, *others = [Image.fromarray(frame) for frame in frames]
    pace = round(1000 * args.every / CONTROL_HZ)
    args.path.parent.mkdir(parents=True, exist_ok=True)
    first.save(args.path, save_all=True, append_images=others, duration=pace, loop=0, quality=args.quality, method=4)


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
