"""Lines that say where a robot is, and how far it has come by them."""

import math

import numpy as np
import pytest

from srl_jax.robot import imu, odometer


class Said:
    """A clock, and a stream of what was given to it."""

    def __init__(self):
        self.moment, self.waiting = 0.0, b""

    def now(self):
        return self.moment

    def sleep_until(self, moment):
        self.moment = moment

    def read(self):
        found, self.waiting = self.waiting, b""
        return found


@pytest.fixture
def told():
    said = Said()
    return said, odometer.Odometer(said, said)


def test_metres_are_those_ahead_of_where_it_looked(told):
    said, own = told
    said.waiting = odometer.line(np.array([1.0, 2.0]), math.pi / 2)
    assert own.come() == 0.0
    said.waiting = odometer.line(np.array([1.5, 2.25]), 0.0)
    assert own.come() == pytest.approx(0.25, abs=1e-3)
    own.begin()
    said.waiting = odometer.line(np.array([1.5, 2.25]), 0.0)
    assert own.come() == 0.0
    said.waiting = odometer.line(np.array([1.0, 2.25]), 0.0)
    assert own.come() == pytest.approx(-0.5)


def test_broken_lines_and_silence_are_no_place(told):
    said, own = told
    assert math.isnan(own.come())
    good = odometer.line(np.zeros(2), 0.0)
    said.waiting = good[:5]
    assert math.isnan(own.come())
    said.waiting = good[5:]
    assert own.come() == 0.0
    said.waiting = odometer.line(np.ones(2), 0.0).replace(b"1000", b"1001", 1)
    assert own.come() == 0.0
    said.moment = 0.2
    assert math.isnan(own.come())


def test_what_was_said_before_an_episode_is_forgotten(told):
    said, own = told
    said.waiting = odometer.line(np.array([9.0, 0.0]), 0.0)
    own.begin()
    assert math.isnan(own.come())


@pytest.mark.parametrize("text", [b"", b"$O", b"$O,1,2*00", b"$G,1,2,3*55", b"$O,a,2,3*00", b"$O,1,2,3*"])
def test_what_is_no_line_is_none(text):
    assert imu.numbers_of(text, b"O", 3) is None
