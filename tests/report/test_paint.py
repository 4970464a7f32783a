"""Pictures show the robot as it is, whoever paints them."""

import mujoco
import numpy as np
import pytest

from srl_jax.env.model import stance
from srl_jax.report import paint, raycast

SIZE = (160, 90)


@pytest.fixture(autouse=True)
def fresh_backend():
    paint.backend.cache_clear()
    yield
    paint.backend.cache_clear()


def orange(picture: np.ndarray) -> int:
    """Pixels of the tibiae and the board."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    return int(((red > 120) & (red > green + 40) & (green > blue)).sum())


def coloured(picture: np.ndarray, rgb) -> int:
    hue = picture / np.maximum(picture.max(-1, keepdims=True), 1)
    return int((np.abs(hue - np.array(rgb) / max(rgb)).max(-1) < 0.12).sum())


def test_lost_parts_are_not_drawn_and_disobedient_ones_are_coloured():
    healthy, tibia, leg = (paint.still(name, painter="plain") for name in ("healthy", "tibia_rf", "leg_rf+leg_rr"))
    assert orange(healthy) > 1.1 * orange(tibia) > 1.1 * orange(leg) > 0
    limp, locked = (paint.still(f"tibia_rf:{kind}", painter="plain") for kind in ("limp", "locked"))
    assert coloured(limp, paint.LIMP) > 200 > 20 > coloured(healthy, paint.LIMP)
    assert coloured(locked, paint.LOCKED) > 200 > 20 > coloured(healthy, paint.LOCKED)


def test_the_camera_follows():
    model = paint.visible_model("healthy")
    poses = np.tile(stance(model), (2, 1))
    poses[1, :2] = [1.0, 0.5]  # whole pairs of tiles, so the floor looks the same
    near, far = paint.paint(model, poses, None, painter="plain", size=SIZE)
    assert np.abs(near.astype(int) - far).max() < 80  # an edge may fall on the next ray
    assert np.abs(near.astype(int) - far).mean() < 0.2


@pytest.mark.parametrize("name", ["healthy", "leg_rf+leg_lm", "tibia_rf:limp"])
def test_rays_meet_what_mujocos_rays_meet(name):
    model = paint.visible_model(name)
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    data.qpos[:] = stance(model)
    data.qpos[7:] += random.uniform(-0.5, 0.5, 18)
    mujoco.mj_forward(model, data)
    hits = 0
    for _ in range(150):
        origin = random.normal((0, 0, 0.8), 0.6)
        target = random.uniform((-0.2, -0.2, 0.02), (0.2, 0.2, 0.15))
        ray = target - origin
        if np.linalg.norm(np.subtract(origin, (0, 0, 0.1))) < 0.35:
            continue  # MuJoCo's rays also meet surfaces from within
        expected = mujoco.mj_ray(model, data, origin, ray, None, 1, -1, np.zeros(1, np.int32))
        found = [
            raycast._hit(geom, origin[:, None, None], ray[:, None, None].astype(np.float32))[0].item()
            for geom in raycast._geoms(model, data, None)
        ]
        floor = -origin[2] / ray[2] if ray[2] < 0 < origin[2] else np.inf
        nearest = min(*found, floor)
        hits += nearest < floor
        assert nearest == pytest.approx(expected if expected >= 0 else np.inf, abs=2e-3)
    assert hits > 50


def test_opengl_shows_the_same_as_rays():
    if paint.backend() is None:
        pytest.skip("no OpenGL here")
    gl, plain = (paint.still("leg_rm", painter=painter).astype(int) for painter in ("gl", "plain"))
    assert np.abs(gl - plain).mean() < 30  # of 255: the tiles start elsewhere
    assert np.abs(orange(gl) / orange(plain) - 1) < 0.15


def test_a_driver_that_kills_its_process_counts_as_none(monkeypatch):
    monkeypatch.setattr(paint, "PROBE", "import os; os.abort()  # {0}")
    assert paint.backend() is None


def test_no_opengl_is_said_where_it_was_asked_for(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    assert paint.backend() is None
    with pytest.raises(RuntimeError, match="neither EGL nor OSMesa works here: choose 'plain' or 'auto'"):
        paint.still("healthy", painter="gl")
    assert paint.still("healthy", size=SIZE).shape == (90, 160, 3)
