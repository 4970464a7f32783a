"""A simulated robot in lock-step with the loop: no pseudo-terminal, no waiting, the same numbers every time.

Time goes on where the host waits: for an answer, or for its next deadline.
"""

from collections import deque

from srl_jax.robot.ports import ANSWER, BusLostError, Port
from srl_jax.robot.simulate.body import Body
from srl_jax.robot.simulate.line import Answer, Faults, Line


class Lockstep:
    """A clock that a simulated robot follows; also the stream of its inertial unit."""

    def __init__(self, body: Body) -> None:
        self.body, self._now = body, body.now

    def now(self) -> float:
        """Seconds of the simulation."""
        return self._now

    def sleep_until(self, moment: float) -> None:
        """Simulates until then."""
        self._now = max(self._now, moment)
        self.body.advance(self._now)

    def read(self) -> bytes:
        """What the inertial unit has said."""
        self.body.advance(self._now)
        return self.body.lines()


class Overhead:
    """The stream of an odometer that sees a simulated robot."""

    def __init__(self, clock: Lockstep) -> None:
        self._clock = clock

    def read(self) -> bytes:
        """Where it is now."""
        self._clock.body.advance(self._clock.now())
        return self._clock.body.placed()


class Wire(Port):
    """The port of a simulated line."""

    def __init__(self, clock: Lockstep, faults: Faults | None = None, latency: float = 0.001, seed: int = 0) -> None:
        super().__init__("the simulation", clock, ANSWER)
        self.line = Line(clock.body.servos, faults or Faults(), latency, seed)
        self.unplugged = False
        self._clock, self._coming = clock, deque[Answer]()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802  the SDK's name
        """Sends bytes; returns how many."""
        if self.unplugged:
            raise BusLostError(f"{self.port_name} has gone")
        self._clock.body.advance(self.clock.now())
        answers = self.line.feed(bytes(packet), self.clock.now())
        self._coming = deque(sorted([*self._coming, *answers]))  # those that are late are overtaken
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Up to so many bytes, those that come before the packet's time is over; waits for the first of them."""
        if self.unplugged:
            raise BusLostError(f"{self.port_name} has gone")
        end = self.clock.now() + self.left()
        if length <= 0 or not self._coming or self._coming[0].due > end:
            self.clock.sleep_until(end + 1e-6)
            return b""
        due, data = self._coming.popleft()
        self.clock.sleep_until(due)
        if data[length:]:
            self._coming.appendleft(Answer(due, data[length:]))
        return data[:length]

    def clearPort(self) -> None:  # noqa: N802
        """Forgets what has come."""
        while self._coming and self._coming[0].due <= self.clock.now():
            self._coming.popleft()
