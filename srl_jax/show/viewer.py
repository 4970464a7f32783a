"""A walk in MuJoCo's own viewer, in real time."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import mujoco

from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.report.paint import add_marker, visible_model
from srl_jax.report.video import GOAL
from srl_jax.show.walk import Moment, Walk

LOOKS = ("geom_rgba", "geom_matid", "geom_size", "geom_pos")  # of a model, in which a damaged robot differs to the eye
PATIENCE = 5.0  # s that its thread may take to close the window
DISTANCE = 1.2  # m from the camera to the robot, which it follows
PROBE = "import sys, warnings; warnings.simplefilter('ignore'); import glfw; sys.exit(not glfw.init())"


def view(walk: Walk, steps: int) -> Iterator[Moment]:
    """The moments of a walk while they are shown, until its end, its fall or the window's closing.

    Raises:
        ValueError: there is no display, or Python is not the one that may open a window.
    """
    # Where GLFW finds no display, the viewer's thread dies and its caller waits for ever: that is tried elsewhere.
    if subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False).returncode:
        raise ValueError("view needs a display, and there is none here: leave it out for a video.")
    from mujoco import viewer

    models = {damage: visible_model(damage) for damage in (HEALTHY, walk.damage)}
    shown = visible_model(walk.damage if walk.broken else HEALTHY)
    before = set(threading.enumerate())
    try:
        window = viewer.launch_passive(shown, walk.data, show_left_ui=False, show_right_ui=False)
    except RuntimeError as error:
        raise ValueError(f"view: {error}.") from None
    with contextlib.ExitStack() as end:
        # Who leaves Python while the window's thread still draws is killed by it.
        end.callback(lambda: [thread.join(PATIENCE) for thread in set(threading.enumerate()) - before])
        end.enter_context(window)
        _follow(window)
        due = time.perf_counter()
        for moment in walk.until(steps):
            with window.lock():
                for name in LOOKS:
                    getattr(shown, name)[:] = getattr(models[moment.damage], name)
                if moment.goal.any():
                    scene: Any = window.user_scn
                    scene.ngeom = 0
                    add_marker(scene, (moment.goal, EnvConfig().goal_radius, GOAL))
            window.sync()
            yield moment
            if not window.is_running():
                return
            due += 1.0 / CONTROL_HZ
            time.sleep(max(0.0, due - time.perf_counter()))


def _follow(window: Any) -> None:
    window.cam.type, window.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, 1
    window.cam.distance = DISTANCE
