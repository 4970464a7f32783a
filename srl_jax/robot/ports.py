"""Serial ports as the SDK's packet handler wants them, with timeouts that fit in a control period.

The SDK's own port waits 34 ms for a packet that does not come, by a clock that may be set, without ever sleeping.
"""

import os
import select
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import serial
from dynamixel_sdk import PortHandler

from srl_jax.robot.clock import Clock
from srl_jax.robot.table import BAUD

ANSWER = 0.003  # s that a servo and its adapter have to answer, beyond the bytes' own time
AFTER = 3  # reads of what is there already once a packet's time is over


class BusLostError(Exception):
    """The port is gone, or nobody on it answers."""


class Port(PortHandler):
    """What ports of this package share: an injected clock, and reading that ends when the packet's time is over."""

    def __init__(self, name: str, clock: Clock, answer: float = ANSWER) -> None:
        super().__init__(name)
        self.clock, self.answer = clock, answer
        self.tx_time_per_byte = 10.0 * 1000.0 / BAUD

    def getCurrentTime(self) -> float:  # noqa: N802  the SDK's name
        """Milliseconds."""
        return self.clock.now() * 1000.0

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Gives a status packet of so many bytes its time."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 1000.0 * self.answer)

    def left(self) -> float:
        """Seconds that the awaited packet has yet."""
        return (self.packet_timeout - self.getTimeSinceStart()) / 1000.0


class SerialPort(Port):
    """A real adapter, or a pseudo-terminal."""

    ser: Any  # pyserial's, once it is open
    _after = 0  # reads since the packet's time was over

    def openPort(self) -> bool:  # noqa: N802
        """Opens it at 1 Mbps.

        Raises:
            ValueError: there is no such port, or it is no serial port.
        """
        try:
            return bool(super().openPort())
        except (OSError, termios.error) as error:
            raise ValueError(f"port is {self.port_name}: it cannot be opened as a serial port ({error}).") from None

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Up to so many bytes: those that are there, or that come before the packet's time is over; then none."""
        left = self.left()
        # What has come while this program was not let run is taken; but to a babbling line one listens no longer.
        self._after = self._after + 1 if left <= 0.0 else 0
        if length <= 0 or self._after > AFTER:
            return b""
        with lost():
            ready, _, _ = select.select([self.ser.fileno()], [], [], max(left, 0.0))
            if not ready:
                return b""
            found = os.read(self.ser.fileno(), length)
        if not found:  # readable and empty: hung up
            raise BusLostError(f"{self.port_name} has gone")
        return found

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Sends bytes; returns how many."""
        with lost():
            return int(self.ser.write(bytes(packet)) or 0)

    def clearPort(self) -> None:  # noqa: N802
        """Forgets what has come, such as answers that were too late."""
        with lost():
            self.ser.reset_input_buffer()


@contextmanager
def lost() -> Iterator[None]:
    """Turns the ways in which a port says that it is gone into one."""
    try:
        yield
    except (OSError, termios.error, serial.SerialException, TypeError) as error:  # TypeError: closed meanwhile
        raise BusLostError(str(error)) from error


class LinePort:
    """The serial port of what speaks in lines: an inertial unit, an odometer."""

    def __init__(self, name: str, what: str = "imu", baud: int = 115_200) -> None:
        """Opens it; `what` is how the command line calls it.

        Raises:
            ValueError: there is no such port, or it is no serial port.
        """
        try:
            self._serial = serial.Serial(name, baud, timeout=0)
        except (OSError, termios.error) as error:
            raise ValueError(f"{what} is {name}: it cannot be opened as a serial port ({error}).") from None

    def read(self) -> bytes:
        """All that have come; a port that has gone says nothing, which is noticed by its silence."""
        try:
            return self._serial.read(4096)
        except (OSError, termios.error, serial.SerialException):
            return b""
