"""Draw the robot for the README: healthy, and with its right middle leg lost.

python experiments/render_robot.py --path docs/robot.png
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import imageio.v3 as imageio
import numpy as np
import tyro

from srl_jax.cli.ending import leave
from srl_jax.report import paint


@dataclass(frozen=True)
class Args:
    """Write a picture of two robots side by side."""

    path: Path = Path("docs/robot.png")
    damages: tuple[str, ...] = ("healthy", "leg_rm")
    painter: Literal["auto", "gl", "plain"] = "auto"
    width: int = 560
    """Pixels of each robot's picture."""
    height: int = 400
    oversample: int = 2
    """Pixels drawn for each one kept, in each direction."""


def shrink(picture: np.ndarray, times: int) -> np.ndarray:
    """Averages blocks of ``times`` x ``times`` pixels: u8[H, W, 3]."""
    height, width, _ = picture.shape
    blocks = picture.reshape(height // times, times, width // times, times, 3)
    return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)


def main(args: Args) -> None:
    """Writes the picture."""
    size = (args.oversample * args.width, args.oversample * args.height)
    pictures = [
        shrink(paint.still(name, painter=args.painter, size=size, zoom=1.3), args.oversample) for name in args.damages
    ]
    gap = np.full((args.height, 8, 3), 255, np.uint8)
    row = [part for picture in pictures for part in (gap, picture)][1:]
    args.path.parent.mkdir(parents=True, exist_ok=True)
    imageio.imwrite(args.path, np.concatenate(row, axis=1))
    print(args.path)


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
