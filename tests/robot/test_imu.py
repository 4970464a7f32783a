"""Lines of the inertial unit: what they say, what is dropped, and where the heading comes from."""

import numpy as np
import pytest

from srl_jax.robot import imu


class Said:
    """A stream and a clock that a test sets."""

    def __init__(self):
        self.bytes, self.time = b"", 0.0

    def read(self):
        found, self.bytes = self.bytes, b""
        return found

    def now(self):
        return self.time


def test_a_line_comes_back():
    gravity, rate = np.array([0.6, 0.0, -0.8]), np.array([0.1, -2.0, 0.3])
    said = imu.line(gravity, rate)
    assert said.startswith(b"$G,6000,0,-8000,100,-2000,300*")
    assert all(np.allclose(a, b) for a, b in zip(imu.parse(said), (gravity, rate), strict=True))


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"$G,0,0,-10000,0,0,0*00",
        b"$G,0,0,-10000,0,0*5A",
        b"G,0,0,-10000,0,0,0*5A",
        imu.line(np.zeros(3), np.zeros(3)),
        imu.line(np.array([0, 0, -1.0]), np.full(3, 50.0)),
        imu.line(np.array([0, 0, -1.0]), np.zeros(3))[:-4],
    ],
)
def test_what_does_not_add_up_is_dropped(text):
    assert imu.parse(text) is None


def test_noise_is_dropped_and_lines_in_pieces_are_not():
    said, random = Said(), np.random.default_rng(0)
    own = imu.Imu(said, said)
    for _ in range(2_000):
        said.bytes = random.bytes(random.integers(80))
        own.poll()
    assert own.good == 0 and own.bad > 0
    text = b"\n" + imu.line(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 0.5]))
    for part in (text[:9], text[9:]):
        said.bytes = part
        own.poll()
    assert own.good == 1 and own.rate[2] == pytest.approx(0.5)


def test_heading_is_what_turning_adds_up_to_about_what_is_up():
    said = Said()
    own = imu.Imu(said, said, "-y,x,z")
    for _ in range(100):
        said.time += 0.02
        said.bytes = imu.line(np.array([0.0, 0.0, -1.0]), np.array([0.3, 0.0, 0.5]))
        own.poll()
    assert own.heading == pytest.approx(1.0) and np.allclose(own.rate, [0.0, 0.3, 0.5])
    said.time += 0.3
    assert own.silence == pytest.approx(0.3)


@pytest.mark.parametrize("axes", ["x,y", "x,x,z", "x,y,-z", "a,b,c", ""])
def test_axes_that_are_no_frame_are_refused(axes):
    with pytest.raises(ValueError, match="imu-axes is"):
        imu.mounting(axes)
