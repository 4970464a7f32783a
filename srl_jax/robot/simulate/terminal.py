"""The simulated robot behind two pseudo-terminals, in real time."""

import contextlib
import heapq
import json
import os
import pty
import select
import time
import tty

from srl_jax.robot.simulate.body import IMU_PERIOD, Body
from srl_jax.robot.simulate.line import Answer, Line

CHUNK = 4096  # bytes


class Terminal:
    """Three raw pseudo-terminals: the servos' bus, the inertial unit's line, and that of who sees where it is."""

    def __init__(self, body: Body, line: Line, damage: str, strike: float) -> None:
        """Opens them.

        Args:
            body: whose time is `time.monotonic`.
            line: of its servos.
            damage: that will strike.
            strike: s from now until it does; infinite: when it is told to.
        """
        self.body, self.line, self.damage = body, line, damage
        self._strike = time.monotonic() + strike
        body.prepare(damage)
        self._ends = [pty.openpty() for _ in range(3)]  # our end and that of the host, which we keep open too
        for ours, theirs in self._ends:
            tty.setraw(theirs)
            os.set_blocking(ours, False)
        self.bus, self.imu, self.odometer = (os.ttyname(theirs) for _, theirs in self._ends)
        self._coming: list[Answer] = []
        self._plugged = True
        self._turned, self._stall = time.monotonic(), 0.0  # s that it has not been let run, at worst

    def serve(self, orders: int | None = None) -> None:
        """Answers until it is interrupted.

        Args:
            orders: a file descriptor; lines on it are obeyed, and it serves until their end. ``strike``: the damage
                strikes. ``unplug``: the bus hangs up. ``right``: it is put on its feet. ``report``: a line of JSON on
                the standard output says where the robot is and what it does, and for how long the machine has not let
                it run at worst since the last.
        """
        said = b""
        while True:
            self._turn()
            waiting = self._coming[0].due - time.monotonic() if self._coming else IMU_PERIOD / 2
            sources = [self._ends[0][0]] * self._plugged + ([] if orders is None else [orders])
            ready, _, _ = select.select(sources, [], [], max(min(waiting, IMU_PERIOD / 2), 0.0))
            if self._plugged and self._ends[0][0] in ready:
                self._hear()
            if orders is not None and orders in ready:
                news = os.read(orders, CHUNK)
                if not news:
                    return
                *whole, said = (said + news).split(b"\n")
                for order in whole:
                    self._obey(order.decode().strip())

    def close(self) -> None:
        """Hangs up."""
        for end in (*(self._ends[0] if self._plugged else ()), *self._ends[1], *self._ends[2]):
            os.close(end)

    def _turn(self) -> None:
        now = time.monotonic()
        self._stall, self._turned = max(self._stall, now - self._turned), now
        while self._coming and self._coming[0].due <= now:
            self._say(0, heapq.heappop(self._coming).data)
        if now >= self._strike:
            self._strike = float("inf")
            self.body.strike(self.damage)
        self.body.advance(now)
        if lines := self.body.lines():
            self._say(1, lines)
            self._say(2, self.body.placed())

    def _hear(self) -> None:
        now = time.monotonic()
        self.body.advance(now)
        for answer in self.line.feed(os.read(self._ends[0][0], CHUNK), now):
            heapq.heappush(self._coming, answer)

    def _say(self, which: int, data: bytes) -> None:
        if which or self._plugged:
            with contextlib.suppress(BlockingIOError):  # nobody reads: bytes are lost, as on a wire
                os.write(self._ends[which][0], data)

    def _obey(self, order: str) -> None:
        if order == "strike":
            self._strike = time.monotonic()
        elif order == "unplug" and self._plugged:
            self._plugged = False
            for end in self._ends[0]:
                os.close(end)
        elif order == "right":
            self.body.right()
        elif order == "report":
            found = self.body.report() | {"heard": self.line.heard, "stall": self._stall}
            print(json.dumps(found), flush=True)
            self._stall = 0.0
