"""Videos: that the pictures show the robot as it is, and that a file is left on any machine."""

import subprocess
import sys

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

from srl_jax.env.model import stance
from srl_jax.evaluate import Rollout
from srl_jax.report import raycast, video

SIZE = (160, 90)


@pytest.fixture(autouse=True)
def fresh_backend():
    video.backend.cache_clear()
    yield
    video.backend.cache_clear()


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    """Three steps to the right, of which the third comes after the end."""
    qpos = np.tile(stance(video.visible_model("healthy")), (3, 1))
    qpos[:, 0] = [0.1, 0.2, 0.2]
    zero, yes = np.zeros(()), np.array(True)
    return Rollout(qpos, np.zeros(3), yes, ~yes, zero, np.array(2), np.array([0.5, 0.0]))


def orange(picture: np.ndarray) -> int:
    """Pixels of the tibiae and the board."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    return int(((red > 120) & (red > green + 40) & (green > blue)).sum())


def coloured(picture: np.ndarray, rgb) -> int:
    hue = picture / np.maximum(picture.max(-1, keepdims=True), 1)
    return int((np.abs(hue - np.array(rgb) / max(rgb)).max(-1) < 0.12).sum())


def test_frames_have_a_caption_and_hold_the_end(rollout):
    frames = video.render(rollout, "healthy", painter="plain", size=SIZE)
    assert frames.shape == (2 + video.HOLD, 90 + video.STRIP, 160, 3)
    assert frames.dtype == np.uint8
    assert not np.array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[1], frames[-1])
    strip = frames[0, 90:]
    assert strip.min() < 60 < 180 < strip.max()  # light letters on a dark ground


def test_lost_parts_are_not_drawn_and_disobedient_ones_are_coloured():
    healthy, tibia, leg = (video.still(name, painter="plain") for name in ("healthy", "tibia_rf", "leg_rf+leg_rr"))
    assert orange(healthy) > 1.1 * orange(tibia) > 1.1 * orange(leg) > 0
    limp, locked = (video.still(f"tibia_rf:{kind}", painter="plain") for kind in ("limp", "locked"))
    assert coloured(limp, video.LIMP) > 200 > 20 > coloured(healthy, video.LIMP)
    assert coloured(locked, video.LOCKED) > 200 > 20 > coloured(healthy, video.LOCKED)


def test_the_goal_is_marked(rollout):
    with_goal = video.render(rollout, "healthy", painter="plain")[0]
    without = video.render(rollout._replace(goal=np.zeros(2)), "healthy", painter="plain")[0]
    assert coloured(with_goal[:360], video.GOAL) > 100
    assert coloured(without[:360], video.GOAL) == 0


def test_the_camera_follows():
    model = video.visible_model("healthy")
    poses = np.tile(stance(model), (2, 1))
    poses[1, :2] = [1.0, 0.5]  # whole pairs of tiles, so the floor looks the same
    near, far = video.paint(model, poses, None, painter="plain", size=SIZE)
    assert np.abs(near.astype(int) - far).max() < 80  # an edge may fall on the next ray
    assert np.abs(near.astype(int) - far).mean() < 0.2


@pytest.mark.parametrize("name", ["healthy", "leg_rf+leg_lm", "tibia_rf:limp"])
def test_rays_meet_what_mujocos_rays_meet(name):
    model = video.visible_model(name)
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


def test_opengl_shows_the_same_as_rays(rollout):
    if video.backend() is None:
        pytest.skip("no OpenGL here")
    gl, plain = (video.render(rollout, "leg_rm", painter=painter)[0].astype(int) for painter in ("gl", "plain"))
    assert np.abs(gl - plain).mean() < 30  # of 255: the tiles start elsewhere
    assert np.abs(orange(gl) / orange(plain) - 1) < 0.15


def test_without_opengl_there_is_still_a_video(rollout, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    assert video.backend() is None
    assert video.render(rollout, "healthy", size=SIZE).shape[0] == 2 + video.HOLD
    with pytest.raises(RuntimeError, match="neither EGL nor OSMesa works here: choose 'plain' or 'auto'"):
        video.still("healthy", painter="gl")


def test_a_driver_that_kills_its_process_counts_as_none(monkeypatch):
    monkeypatch.setattr(video, "PROBE", "import os; os.abort()  # {0}")
    assert video.backend() is None


def test_a_batch_of_rollouts_is_refused(rollout):
    with pytest.raises(ValueError, match=r"has 3 axes; one episode \[T, 25\] is accepted"):
        video.render(rollout._replace(qpos=rollout.qpos[None]), "healthy")
    with pytest.raises(ValueError, match="unknown part"):
        video.render(rollout, "knee_rm")


def test_a_video_can_be_read_again(tmp_path):
    frames = np.zeros((12, 64, 96, 3), np.uint8)
    frames[:, :, :48] = 200
    video.save_video(tmp_path / "deep" / "walk.mp4", frames)
    path = tmp_path / "deep" / "walk.mp4"
    assert imageio_ffmpeg.count_frames_and_secs(path) == (12, pytest.approx(0.6))
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    read = np.frombuffer(raw, np.uint8).reshape(frames.shape)
    assert np.abs(read.astype(int) - frames).mean() < 4
    with pytest.raises(ValueError, match="frames is empty"):
        video.save_video(tmp_path / "none.mp4", [])


def test_writing_after_jax_has_run_warns_of_nothing(tmp_path):
    program = (
        "import jax, numpy; jax.numpy.ones(3).sum().block_until_ready()\n"
        "from srl_jax.report.video import save_video\n"
        f"save_video({str(tmp_path / 'walk.mp4')!r}, numpy.zeros((3, 16, 16, 3), numpy.uint8))"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "walk.mp4").stat().st_size > 0
