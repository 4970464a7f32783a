"""Videos of rollouts, with a caption below the pictures; a file is written whole or not at all."""

import itertools
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.evaluate import Rollout
from srl_jax.report import raycast
from srl_jax.report.paint import SIZE, Painter, paint, visible_model

STRIP = 24  # pixels of the caption below the picture
HOLD = 10  # frames for which the last pose stays, so that the outcome can be read
GOAL = (0.10, 0.62, 0.35)


def render(
    rollout: Rollout,
    damage_name: str,
    anatomy: Anatomy = PHANTOMX,
    *,
    goal_radius: float = 0.15,
    painter: Painter = "auto",
    size: tuple[int, int] = SIZE,
) -> np.ndarray:
    """The frames of one episode, each with a caption of damage, time and distance.

    Args:
        rollout: of one episode, without a leading axis.
        damage_name: as `damage_names.canonical`; lost parts are not drawn, limp links are violet, locked ones blue.
        anatomy: of the robot.
        goal_radius: m, of the disc that marks a goal.
        painter: ``gl``, ``plain``, or ``auto`` for ``gl`` where it works.
        size: width and height of the picture in pixels, both even.

    Returns:
        u8[F, height + 24, width, 3] at 20 frames a second.

    Raises:
        ValueError: for a bad damage name, or a rollout with a leading axis.
        RuntimeError: for ``gl`` where no OpenGL backend works.
    """
    poses = np.asarray(rollout.qpos, np.float64)
    if poses.ndim != 2:
        raise ValueError(
            f"rollout.qpos has {poses.ndim} axes; one episode [T, {poses.shape[-1]}] is accepted: pick a row."
        )
    poses = poses[: int(rollout.length)]
    goal = np.asarray(rollout.goal, np.float64)
    marker = (goal, goal_radius, GOAL) if goal.any() else None
    outcome = "tipped over" if rollout.fell else "goal reached" if rollout.success else ""
    frames = []
    for t, picture in enumerate(paint(visible_model(damage_name, anatomy), poses, marker, painter=painter, size=size)):
        text = _caption(damage_name, t + 1, poses[t, :2], marker)
        end = outcome if t + 1 == len(poses) else ""
        frames.append(np.concatenate([picture, caption(text, end, size[0])]))
    return np.stack(frames + frames[-1:] * HOLD)


def save_video(path: str | Path, frames: Iterable[np.ndarray], fps: int = int(CONTROL_HZ)) -> None:
    """Writes u8[H, W, 3] frames of one even size as H.264 in an mp4, all of it or nothing.

    Args:
        path: the file to write; missing folders are made.
        frames: at least one; an array u8[F, H, W, 3] will do.
        fps: frames a second.

    Raises:
        ValueError: if there is no frame.
    """
    # Otherwise ffmpeg is started by fork, which may deadlock in a process where jax has threads.
    os.environ.setdefault("IMAGEIO_FFMPEG_NO_PREVENT_SIGINT", "1")
    import imageio_ffmpeg

    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise ValueError(f"frames is empty; {path} needs at least one.")
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    size = (first.shape[1], first.shape[0])
    partial = Path(path).with_suffix(".partial")  # which says nothing to ffmpeg of its format
    options: Any = {"quality": 8, "macro_block_size": 2, "ffmpeg_log_level": "error", "output_params": ["-f", "mp4"]}
    writer = imageio_ffmpeg.write_frames(str(partial), size, fps=fps, **options)
    writer.send(None)
    try:
        for frame in itertools.chain((first,), frames):
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()
    partial.replace(path)


def _caption(damage_name: str, steps: int, position: np.ndarray, marker: raycast.Goal | None) -> str:
    text = f"{damage_name}    {steps / CONTROL_HZ:5.2f} s    {np.linalg.norm(position):.2f} m from the start"
    if marker is not None:
        text += f"    {np.linalg.norm(marker[0] - position):.2f} m to the goal"
    return text


def caption(text: str, end: str, width: int) -> np.ndarray:
    """A line of text, and one to its right: u8[24, width, 3]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 100, STRIP / 100), dpi=100, facecolor="#1d2026")
    canvas = FigureCanvasAgg(figure)
    style: Any = {"fontsize": 8.5, "family": "DejaVu Sans", "verticalalignment": "center"}
    figure.text(10 / width, 0.45, text, color="#f2f2f2", **style)
    figure.text(1 - 10 / width, 0.45, end, color="#ffb84d", horizontalalignment="right", **style)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[:, :, :3]
