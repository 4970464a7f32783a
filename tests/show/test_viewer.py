"""The viewer follows a walk; without a display there is a sentence, and nobody waits."""

import contextlib
import types

import mujoco
import numpy as np
import pytest
from mujoco import viewer as mujoco_viewer

from srl_jax.show import viewer
from srl_jax.show.walk import Walk
from srl_jax.show.walker import tripod


class Window:
    """A window that is closed after some pictures."""

    def __init__(self, model, pictures):
        self.model, self.left, self.shown = model, pictures, []
        self.cam, self.user_scn = types.SimpleNamespace(), mujoco.MjvScene(model, maxgeom=10)

    def lock(self):
        return contextlib.nullcontext()

    def sync(self):
        self.left -= 1
        self.shown.append(self.model.geom_rgba[:, 3].sum())

    def is_running(self):
        return self.left > 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


def opened(monkeypatch, pictures):
    """The windows that will be opened, in place of MuJoCo's."""
    windows = []
    monkeypatch.setattr(viewer, "PROBE", "")

    def launch(model, data, **options):
        windows.append(Window(model, pictures))
        return windows[-1]

    monkeypatch.setattr(mujoco_viewer, "launch_passive", launch)
    return windows


def test_it_shows_the_damage_when_it_strikes(monkeypatch):
    windows = opened(monkeypatch, pictures=6)
    moments = list(viewer.view(Walk(tripod("x"), "leg_rm", strike=3), 20))
    assert len(moments) == 6  # until the window is closed
    visible = np.array(windows[0].shown)
    assert (visible[:3] == visible[0]).all() and (visible[3:] < visible[0]).all()
    assert windows[0].cam.trackbodyid == 1


def test_it_marks_the_goal(monkeypatch):
    windows = opened(monkeypatch, pictures=2)
    moments = list(viewer.view(Walk(tripod("p2p"), "leg_rm", strike=3), 20))
    scene = windows[0].user_scn
    assert scene.ngeom == 3
    np.testing.assert_allclose(scene.geoms[0].pos[:2], moments[-1].goal, atol=1e-6)


def test_without_a_display_there_is_a_sentence(monkeypatch):
    monkeypatch.setattr(viewer, "PROBE", "import sys; sys.exit(1)")
    with pytest.raises(ValueError, match="view needs a display, and there is none here: leave it out for a video"):
        next(viewer.view(Walk(tripod("x"), "leg_rm", strike=3), 20))
