"""A walk as a video: who walks, how fast, and what has broken."""

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.report.pace import WINDOW, speeds
from srl_jax.report.paint import SIZE, Painter, paint, visible_model
from srl_jax.report.video import GOAL, HOLD, caption
from srl_jax.show.walk import Moment


def frames(
    moments: Sequence[Moment], task: str, *, painter: Painter = "auto", size: tuple[int, int] = SIZE
) -> Iterator[np.ndarray]:
    """Pictures u8[height + 48, width, 3] at 20 frames a second, with two lines of captions; the last one is held.

    Args:
        moments: of one walk, at least one.
        task: x, xy or p2p.
        painter: as `paint`.
        size: width and height of the picture in pixels, both even.
    """
    pace, pictures = speeds(np.stack([moment.qpos for moment in moments]), task), drawn(moments, painter, size)
    struck = next((step for step, moment in enumerate(moments) if moment.damage != HEALTHY), len(moments))
    frame = None
    for step, (moment, picture) in enumerate(zip(moments, pictures, strict=True)):
        news = "the damage strikes" if struck <= step < struck + WINDOW else "tipped over" if moment.fell else ""
        lines = [
            caption(f"{(step + 1) / CONTROL_HZ:.1f} s    {pace[step]:.2f} m/s    {moment.walker}", news, size[0]),
            caption(_below(moment), "", size[0]),
        ]
        frame = np.concatenate([picture, *lines])
        yield frame
    if frame is not None:
        yield from [frame] * HOLD


def told(moments: Sequence[Moment], task: str) -> Iterator[str]:
    """What happened, a line for each who walked under a damage: the mean of its speeds, and how it ended."""
    pace, before = speeds(np.stack([moment.qpos for moment in moments]), task), 0
    for (walker, damage), own in groupby(enumerate(moments), lambda pair: (pair[1].walker, pair[1].damage)):
        steps, those = zip(*own, strict=True)
        goals = f", {those[-1].reached - before} goals" if those[0].goal.any() else ""
        fell = ", and it tipped over" if those[-1].fell else ""
        speed, seconds = pace[list(steps)].mean(), len(steps) / CONTROL_HZ
        yield f"{damage}: {walker} walks {speed:.2f} m/s for {seconds:g} s{goals}{fell}."
        before = those[-1].reached


def _below(moment: Moment) -> str:
    if not moment.goal.any():
        return moment.damage
    left = np.linalg.norm(moment.goal - moment.qpos[:2])
    return f"{moment.damage}    goals reached: {moment.reached}    {left:.2f} m to the goal"


def drawn(moments: Sequence[Moment], painter: Painter, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """Pictures u8[height, width, 3] without captions, by stretches of one damage and one goal."""
    for (damage, *goal), own in groupby(moments, lambda moment: (moment.damage, *moment.goal)):
        marker = (np.array(goal), EnvConfig().goal_radius, GOAL) if any(goal) else None
        poses = np.stack([moment.qpos for moment in own])
        yield from paint(visible_model(damage), poses, marker, painter=painter, size=size)
