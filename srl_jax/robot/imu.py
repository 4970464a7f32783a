"""The inertial unit: gravity and turning rate, a line at a time over a serial port.

A line is ASCII, fifty to two hundred of them a second::

    $G,<gx>,<gy>,<gz>,<wx>,<wy>,<wz>*<sum>

g: direction of gravity in the unit's frame, in 1/10000 (at rest and level 0,0,-10000). w: turning rate, mrad/s,
positive counter-clockwise about each axis. sum: exclusive or of all characters between $ and *, as two hexadecimal
digits. All six are whole numbers. A line that does not add up is dropped.
"""

import math
from functools import reduce
from typing import Protocol

import numpy as np

from srl_jax.robot.clock import Clock

UNIT, RATE = 1e-4, 1e-3  # of the numbers in a line
LONGEST = 96  # characters of a line
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


class Stream(Protocol):
    """What bytes come from."""

    def read(self) -> bytes:
        """All that have come, without waiting."""
        ...


def line(gravity: np.ndarray, rate: np.ndarray) -> bytes:
    """The line that says a direction of gravity f[3] and a turning rate f[3] (rad/s)."""
    numbers = [round(float(x) / UNIT) for x in gravity] + [round(float(x) / RATE) for x in rate]
    text = ",".join(["G", *map(str, numbers)])
    return sealed(text)


def sealed(text: str) -> bytes:
    """A line of a text, with its sum."""
    return f"${text}*{_sum(text.encode()):02X}\n".encode()


def numbers_of(text: bytes, name: bytes, count: int) -> np.ndarray | None:
    """The whole numbers f64[count] of a line that begins with a name; None where it is not one, or does not add up."""
    body, star, check = text.strip().partition(b"*")
    fields = body[1:].split(b",")
    if not (body.startswith(b"$" + name + b",") and star and len(fields) == 1 + count and len(text) <= LONGEST):
        return None
    try:
        if int(check, 16) != _sum(body[1:]):
            return None
        return np.array([int(field) for field in fields[1:]], float)
    except (ValueError, OverflowError):
        return None


def parse(text: bytes) -> tuple[np.ndarray, np.ndarray] | None:
    """Gravity f64[3], of length 1, and turning rate f64[3] (rad/s) of a line; None where it does not add up."""
    numbers = numbers_of(text, b"G", 6)
    if numbers is None:
        return None
    length = float(np.linalg.norm(numbers[:3])) * UNIT
    if not 0.8 < length < 1.2 or np.abs(numbers[3:]).max() * RATE > 40.0:
        return None
    return numbers[:3] * UNIT / length, numbers[3:] * RATE


def _sum(text: bytes) -> int:
    return reduce(lambda a, b: a ^ b, text, 0)


def mounting(axes: str) -> np.ndarray:
    """The rotation f64[3, 3] from the unit's frame to the body's, x ahead, y to the left, z up.

    Args:
        axes: the unit's axes that point ahead, to the left and up, such as ``x,y,z`` or ``-y,x,z``.

    Raises:
        ValueError: they are not three axes of a right-handed frame.
    """
    rows = [np.array(AXES.get(axis.strip().lstrip("-"), (0, 0, 0))) for axis in axes.split(",")]
    signs = [-1.0 if axis.strip().startswith("-") else 1.0 for axis in axes.split(",")]
    found = np.array([sign * row for sign, row in zip(signs, rows, strict=True)])
    if found.shape != (3, 3) or round(float(np.linalg.det(found))) != 1:
        raise ValueError(
            f"imu-axes is {axes!r}: give the unit's axes that point ahead, to the left and up, of a right-handed "
            "frame, such as x,y,z or -y,x,z."
        )
    return found


class Imu:
    """The newest line of a stream, and the heading that its turning rates add up to."""

    def __init__(self, stream: Stream, clock: Clock, axes: str = "x,y,z") -> None:
        """A unit that has not said anything yet; `axes` as `mounting`."""
        self._stream, self._clock, self._turn = stream, clock, mounting(axes)
        self._waiting = b""
        self.gravity, self.rate = np.array([0.0, 0.0, -1.0]), np.zeros(3)  # f64[3], body frame
        self.heading = 0.0  # rad counter-clockwise since the start; drifts as the gyroscope does
        self.heard = clock.now()  # when the last good line came
        self.good = self.bad = 0  # lines

    def poll(self) -> None:
        """Takes in all that has come."""
        now = self._clock.now()
        *lines, rest = (self._waiting + self._stream.read()).split(b"\n")
        self._waiting = rest[-LONGEST:]
        found = [parse(text) for text in lines]
        good = [each for each in found if each is not None]
        self.bad += len(found) - len(good)
        self.good += len(good)
        if not good:
            return
        each = (now - self.heard) / len(good)  # lines have no time of their own; over a period it is the same
        for gravity, rate in good:
            self.gravity, self.rate = self._turn @ gravity, self._turn @ rate
            self.heading -= each * float(self.rate @ self.gravity)  # about what is up
        self.heading = math.remainder(self.heading, math.tau)
        self.heard = now

    @property
    def silence(self) -> float:
        """Seconds since the last good line."""
        return self._clock.now() - self.heard
