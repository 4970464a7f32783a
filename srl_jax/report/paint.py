"""Pictures of the robot: by MuJoCo's renderer where OpenGL works, otherwise by a small ray caster in NumPy.

OpenGL needs a driver (EGL or OSMesa) that a bare machine lacks, and asking for a missing one can break
MuJoCo's import or kill the process, so each is first tried in a process of its own. Thus every run leaves
its videos.
"""

import importlib
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, Literal

import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.model import stance
from srl_jax.report import raycast

Painter = Literal["auto", "gl", "plain"]

SIZE = (640, 360)  # pixels of a picture, width and height
LIMP, LOCKED = (0.58, 0.33, 0.75), (0.16, 0.42, 0.82)  # colours of links whose joint does not obey

PROBE = """
import os, mujoco, mujoco.{0} as gl
context = gl.GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
os._exit(0)
"""


@cache
def backend() -> str | None:
    """The OpenGL backend that works here without a screen, ``egl`` or ``osmesa``, or None.

    `MUJOCO_GL` is respected: ``egl`` or ``osmesa`` allows that one only, ``disable`` and the like none.
    """
    wish = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wish in ("disable", "disabled", "off", "false", "0"):
        return None
    for name in (wish,) if wish in ("egl", "osmesa") else ("egl", "osmesa"):
        try:
            trial = [sys.executable, "-c", PROBE.format(name)]
            if not subprocess.run(trial, capture_output=True, timeout=60, check=False).returncode:
                return name
        except (OSError, subprocess.TimeoutExpired):
            continue
    return None


def still(
    damage_name: str,
    anatomy: Anatomy = PHANTOMX,
    *,
    painter: Painter = "auto",
    size: tuple[int, int] = SIZE,
    zoom: float = 1.0,
) -> np.ndarray:
    """The damaged robot in its stance, ``zoom`` times as large: u8[height, width, 3]; errors as `paint`."""
    model = visible_model(damage_name, anatomy)
    model.cam_fovy[:] /= zoom
    return next(paint(model, stance(model)[None], None, painter=painter, size=size))


def visible_model(damage_name: str, anatomy: Anatomy = PHANTOMX) -> mujoco.MjModel:
    """The model of a damaged robot with its disobedient links coloured.

    Raises:
        ValueError: for a bad damage name.
    """
    model = damages.damaged_model(damage_name, anatomy)
    for actuator in np.flatnonzero(model.actuator_gainprm[:, 0] == 0):
        joint = model.actuator_trnid[actuator, 0]
        locked = model.dof_armature[model.jnt_dofadr[joint]] >= damages.LOCK_ARMATURE
        geoms = (model.geom_bodyid == model.jnt_bodyid[joint]) & (model.geom_rgba[:, 3] > 0)
        model.geom_matid[geoms] = -1
        model.geom_rgba[geoms, :3] = LOCKED if locked else LIMP
    return model


def paint(
    model: mujoco.MjModel,
    poses: Iterable[np.ndarray],
    marker: raycast.Goal | None,
    *,
    painter: Painter = "auto",
    size: tuple[int, int] = SIZE,
) -> Iterator[np.ndarray]:
    """Pictures u8[height, width, 3] of f[F, J + 7] poses, each when it is asked for, seen by the camera ``track``.

    Raises:
        RuntimeError: for the painter ``gl`` where no OpenGL backend works.
    """
    if painter == "gl" and backend() is None:
        raise RuntimeError("painter is 'gl', but neither EGL nor OSMesa works here: choose 'plain' or 'auto'.")
    draw = _paint_gl if painter != "plain" and backend() else _paint_plain
    yield from draw(model, poses, marker, size)


def _paint_gl(model: mujoco.MjModel, poses, marker: raycast.Goal | None, size: tuple[int, int]) -> Iterator[np.ndarray]:
    # mujoco.Renderer is bound to the backend that was chosen when mujoco was imported; its parts are not.
    gl: Any = importlib.import_module(f"mujoco.{backend()}")
    width, height = size
    model.vis.global_.offwidth, model.vis.global_.offheight = size
    # A shadow map costs as much as the rest where OpenGL is software: only large pictures get a fine one.
    model.vis.quality.shadowsize = 2048 if width <= SIZE[0] else 8192
    model.vis.map.shadowclip = 1.8  # a narrower light speckles the floor at its border
    model.mat_reflectance[:] = 0.0
    context = gl.GLContext(width, height)
    context.make_current()
    canvas = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, canvas)
        scene, area = mujoco.MjvScene(model, maxgeom=200), mujoco.MjrRect(0, 0, width, height)
        camera, option, data = mujoco.MjvCamera(), mujoco.MjvOption(), mujoco.MjData(model)
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera("track").id
        for pose in poses:
            context.make_current()  # again: others may have painted meanwhile
            data.qpos[:] = pose
            model.light_pos[0] = [*pose[:2], 0.0] - model.light_dir[0]  # shadows are cast only about the light's axis
            mujoco.mj_forward(model, data)
            mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            if marker is not None:
                add_marker(scene, marker)
            picture = np.empty((height, width, 3), np.uint8)
            mujoco.mjr_render(area, scene, canvas)
            mujoco.mjr_readPixels(picture, None, area, canvas)
            yield picture[::-1]
    finally:
        context.make_current()
        canvas.free()
        context.free()


def add_marker(scene: mujoco.MjvScene, marker: raycast.Goal) -> None:
    """Adds a disc with a pole and a ball to what MuJoCo draws."""
    place, radius, colour = marker
    shapes = (
        (mujoco.mjtGeom.mjGEOM_CYLINDER, (radius, 0.001, 0.0), 0.001, 0.35),
        (mujoco.mjtGeom.mjGEOM_CAPSULE, (0.006, 0.09, 0.0), 0.09, 1.0),
        (mujoco.mjtGeom.mjGEOM_SPHERE, (0.02, 0.0, 0.0), 0.2, 1.0),
    )
    for shape, extent, height, alpha in shapes:
        geom = scene.geoms[scene.ngeom]
        position, rgba = np.array([*place, height]), np.array([*colour, alpha], np.float32)
        mujoco.mjv_initGeom(geom, shape, np.array(extent), position, np.eye(3).ravel(), rgba)
        scene.ngeom += 1


def _paint_plain(
    model: mujoco.MjModel, poses, marker: raycast.Goal | None, size: tuple[int, int]
) -> Iterator[np.ndarray]:
    data = mujoco.MjData(model)
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        yield raycast.picture(model, data, size, marker)
