"""A recovery to look at: speed, belief and policies against time, and a video beside the robot that knows nothing."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.report import video
from srl_jax.report.pace import rates
from srl_jax.report.paint import paint, visible_model
from srl_jax.report.style import OTHERS, PALETTE, STYLE

SIZE = (480, 270)  # pixels of each of the two pictures
SHOWN = 4  # hypotheses that have a colour


class Walker(NamedTuple):
    """What one robot did and thought in T control steps."""

    positions: np.ndarray  # f64[T, 25]
    come: np.ndarray  # f64[T] m along its task
    policy: Sequence[str]  # in words, at every step
    thought: Sequence[str]  # likeliest, at every step


def save_figure(
    path: Path, own: Walker, unaware: Walker, belief: np.ndarray, names: Sequence[str], strike: int
) -> None:
    """Writes a PNG: speed of both robots above, the posterior of the one that has an atlas below.

    Args:
        path: of the file.
        own: the robot that has an atlas.
        unaware: the one that goes on as if nothing were.
        belief: f32[T, H] probabilities.
        names: of the hypotheses.
        strike: the control step of the damage.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    seconds = np.arange(len(belief)) / CONTROL_HZ
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 5), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(seconds, rates(unaware.come), color=OTHERS, label="knows nothing")
        above.plot(seconds, rates(own.come), color=PALETTE[0], label="with an atlas")
        above.set_ylabel("m/s")
        above.set_ylim(bottom=min(0.0, above.get_ylim()[0]))
        for step in (t for t in range(1, len(seconds)) if own.policy[t] != own.policy[t - 1]):
            above.axvline(seconds[step], color="#dddddd", linewidth=0.8, zorder=0)
        above.legend(loc="lower left")
        top = np.argsort(-belief.max(axis=0))[:SHOWN]
        for colour, index in zip(PALETTE, top, strict=False):
            below.plot(seconds, belief[:, index], color=colour, label=names[index])
        below.set_ylabel("probability")
        below.set_xlabel("seconds; policies change at the grey lines")
        below.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        for axis in (above, below):
            axis.axvline(strike / CONTROL_HZ, color="#D55E00", linewidth=1.2)
        figure.savefig(path, dpi=130)


def save_video(path: Path, own: Walker, unaware: Walker, damage: str, strike: int) -> None:
    """Writes an mp4: to the left the robot that knows nothing, to the right the one that has an atlas.

    Args:
        path: of the file.
        own: the robot that has an atlas.
        unaware: the other.
        damage: that strikes both.
        strike: the control step at which it does.
    """
    both = zip(_pictures(unaware, damage, strike), _pictures(own, damage, strike), strict=True)
    video.save_video(path, (np.concatenate(pair, axis=1) for pair in both))


def _pictures(walker: Walker, damage: str, strike: int) -> Iterator[np.ndarray]:
    parts = ((HEALTHY, walker.positions[:strike]), (damage, walker.positions[strike:]))
    pictures = (
        picture for name, poses in parts if len(poses) for picture in paint(visible_model(name), poses, None, size=SIZE)
    )
    pace = rates(walker.come)
    for step, picture in enumerate(pictures):
        said = f"{step / CONTROL_HZ:4.1f} s  {pace[step]:5.2f} m/s   {walker.policy[step]}"
        captions = [video.caption(line, "", SIZE[0]) for line in (said, walker.thought[step])]
        yield np.concatenate([picture, *captions])
