"""Videos say what happened, and a file is left whole on any machine."""

import subprocess
import sys

import imageio_ffmpeg
import numpy as np
import pytest

from srl_jax.env.model import stance
from srl_jax.evaluate import Rollout
from srl_jax.report import paint, video

SIZE = (160, 90)


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    """Three steps to the right, of which the third comes after the end."""
    qpos = np.tile(stance(paint.visible_model("healthy")), (3, 1))
    qpos[:, 0] = [0.1, 0.2, 0.2]
    zero, yes = np.zeros(()), np.array(True)
    return Rollout(qpos, np.zeros(3), yes, ~yes, zero, np.array(2), np.array([0.5, 0.0]))


def test_frames_have_a_caption_and_hold_the_end(rollout):
    frames = video.render(rollout, "healthy", painter="plain", size=SIZE)
    assert frames.shape == (2 + video.HOLD, 90 + video.STRIP, 160, 3)
    assert frames.dtype == np.uint8
    assert not np.array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[1], frames[-1])
    first, last = frames[0, 90:].astype(int), frames[1, 90:].astype(int)
    assert first.min() < 60 < 180 < first.max()  # light letters on a dark ground
    reached = [int(((strip[..., 0] > 180) & (strip[..., 2] < 120)).sum()) for strip in (first, last)]
    assert reached[0] == 0 < reached[1]  # how it ended is said at the end, in orange
    assert not np.array_equal(video.render(rollout, "leg_rm", painter="plain", size=SIZE)[0, 90:], frames[0, 90:])


def coloured(picture: np.ndarray, rgb) -> int:
    hue = picture / np.maximum(picture.max(-1, keepdims=True), 1)
    return int((np.abs(hue - np.array(rgb) / max(rgb)).max(-1) < 0.12).sum())


def test_the_goal_is_marked(rollout):
    with_goal = video.render(rollout, "healthy", painter="plain")[0]
    without = video.render(rollout._replace(goal=np.zeros(2)), "healthy", painter="plain")[0]
    assert coloured(with_goal[:360], video.GOAL) > 100
    assert coloured(without[:360], video.GOAL) == 0


def test_without_opengl_there_is_still_a_video(rollout, monkeypatch):
    monkeypatch.setattr(paint, "backend", lambda: None)
    assert video.render(rollout, "healthy", size=SIZE).shape[0] == 2 + video.HOLD


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


def test_half_a_video_is_never_left(tmp_path):
    def killed():
        yield from np.zeros((5, 64, 96, 3), np.uint8)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.save_video(tmp_path / "walk.mp4", killed())
    assert not (tmp_path / "walk.mp4").exists()
    video.save_video(tmp_path / "walk.mp4", np.zeros((5, 64, 96, 3), np.uint8))
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mp4"]


def test_writing_after_jax_has_run_warns_of_nothing(tmp_path):
    program = (
        "import jax, numpy; jax.numpy.ones(3).sum().block_until_ready()\n"
        "from srl_jax.report.video import save_video\n"
        f"save_video({str(tmp_path / 'walk.mp4')!r}, numpy.zeros((3, 16, 16, 3), numpy.uint8))"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "walk.mp4").stat().st_size > 0
