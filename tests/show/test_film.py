"""A walk as a video says who walks, what has broken, and how it ended."""

import numpy as np

from srl_jax.env.model import load_model, stance
from srl_jax.report.video import GOAL, HOLD
from srl_jax.show import film
from srl_jax.show.walk import Moment
from tests.report.test_video import coloured

SIZE = (160, 90)


def moments(count=4, goal=(0.0, 0.0), fell=False):
    """A robot that goes 5 cm a step along x and as much along y; the damage strikes in the middle."""
    qpos = np.tile(stance(load_model()), (count, 1))
    qpos[:, :2] += 0.05 * np.arange(1, count + 1)[:, None]
    who = [("healthy", "tripod", 0)] * (count // 2) + [("leg_rm", "srl for leg_rm", 2)] * (count - count // 2)
    each = zip(qpos, who, strict=True)
    made = [Moment(q, damage, walker, np.array(goal), reached, False) for q, (damage, walker, reached) in each]
    return [*made[:-1], made[-1]._replace(fell=fell)]


def test_what_happened_is_told():
    lines = list(film.told(moments(80, fell=True), "x"))
    assert lines[0].startswith("healthy: tripod walks 0.") and lines[0].endswith(" m/s for 2 s.")
    assert lines[1] == "leg_rm: srl for leg_rm walks 1.00 m/s for 2 s, and it tipped over."
    assert list(film.told(moments(80, goal=(1.0, 1.0)), "p2p"))[1].endswith("for 2 s, 2 goals.")


def test_frames_have_two_lines_below():
    frames = list(film.frames(moments(), "x", painter="plain", size=SIZE))
    assert len(frames) == 4 + HOLD and frames[0].shape == (90 + 48, 160, 3) and frames[0].dtype == np.uint8
    orange = [int(((frame[90:114, ..., 0] > 180) & (frame[90:114, ..., 2] < 120)).sum()) for frame in frames]
    assert orange[0] == orange[1] == 0 < min(orange[2:4])  # the strike is announced
    np.testing.assert_array_equal(frames[3], frames[-1])


def test_the_robot_breaks_and_the_goal_is_marked():
    whole, *_, lame = film.frames(moments(2, goal=(0.4, 0.1)), "p2p", painter="plain")
    without = next(film.frames(moments(2), "x", painter="plain"))
    assert coloured(whole[:360], GOAL) > 100 > coloured(without[:360], GOAL) == 0
    assert np.abs(whole[:360].astype(int) - lame[:360]).mean() > 0.2
