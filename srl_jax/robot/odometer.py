"""Where the robot is, by whoever sees it: a camera above, motion capture, a wheel that it draws; a line at a time.

A line is ASCII, as often as possible, at least twenty times a second::

    $O,<x>,<y>,<heading>*<sum>

x, y: mm. heading: mrad counter-clockwise of where x grows, of the robot's front. sum: as in an inertial line (`imu`).
A line that does not add up is dropped.
"""

import math

import numpy as np

from srl_jax.robot.clock import Clock
from srl_jax.robot.imu import LONGEST, Stream, numbers_of, sealed

SILENCE = 0.1  # s without a line, after which nobody knows where it is


def line(place: np.ndarray, heading: float) -> bytes:
    """The line that says a place f[2] (m) and a heading (rad)."""
    return sealed(",".join(["O", *(str(round(1e3 * float(x))) for x in (*place, heading))]))


class Odometer:
    """How far it has come in the direction that it looked in when it last began."""

    def __init__(self, stream: Stream, clock: Clock) -> None:
        """Nobody has said anything yet."""
        self._stream, self._clock = stream, clock
        self._waiting, self._heard = b"", -math.inf
        self._pose = np.zeros(3)  # m, m, rad
        self._start: np.ndarray | None = None

    def begin(self) -> None:
        """It is counted from the next line on; what was said before is forgotten, and may be old."""
        self._stream.read()
        self._waiting, self._heard, self._start = b"", -math.inf, None

    def come(self) -> float:
        """Metres; NaN where nobody has said it for `SILENCE`."""
        now = self._clock.now()
        *lines, rest = (self._waiting + self._stream.read()).split(b"\n")
        self._waiting = rest[-LONGEST:]
        for text in lines:
            found = numbers_of(text, b"O", 3)
            if found is not None:
                self._pose, self._heard = found / 1e3, now
        if now - self._heard > SILENCE:
            return math.nan
        if self._start is None:
            self._start = self._pose
        heading = self._start[2]
        return float((self._pose - self._start)[:2] @ [math.cos(heading), math.sin(heading)])
