"""The simulated half-duplex line: bytes in, answers out, and when; parsed here byte by byte."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from srl_jax.robot.simulate.ax12 import CHECKSUM, PING, READ, SYNC_WRITE, Servo
from srl_jax.robot.table import BAUD, BROADCAST, RETURN_DELAY

BYTE = 10.0 / BAUD  # s: eight bits, start and stop
LATE = (0.005, 0.015)  # s that a late packet comes after its time


@dataclass(frozen=True)
class Faults:
    """Shares of packets, in either direction."""

    drop: float = 0.0
    corrupt: float = 0.0
    """One bit is another."""
    late: float = 0.0
    """Of answers: they come 5 to 15 ms after their time."""


def faults(text: str) -> Faults:
    """Faults by name, such as ``drop=.02,corrupt=.01,late=.05``; empty: none.

    Raises:
        ValueError: an unknown name, or what is no share.
    """
    names = [field.name for field in fields(Faults)]
    found: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            found[name.strip()] = -1.0
        if name.strip() not in names or not 0.0 <= found[name.strip()] <= 1.0:
            raise ValueError(f"faults has {part!r}: accepted are {', '.join(names)}, each with a share from 0 to 1.")
    return Faults(**found)


class Answer(NamedTuple):
    """Bytes, and the moment at which the host has them."""

    due: float
    data: bytes


class Line:
    """Servos on one line behind an adapter."""

    def __init__(self, servos: Mapping[int, Servo], given: Faults = Faults(), latency: float = 0.001, seed: int = 0):
        """A quiet line.

        Args:
            servos: by their number.
            given: faults of packets.
            latency: s that the adapter keeps an answer back.
            seed: of the faults.
        """
        self.servos, self.faults, self.latency = servos, given, latency
        self.heard = 0  # good instruction packets
        self._random = np.random.default_rng(seed)
        self._buffer = bytearray()

    def feed(self, data: bytes, now: float) -> list[Answer]:
        """Takes in bytes that the host has sent by `now`; the answers they bring about."""
        self._buffer += data
        answers: list[Answer] = []
        while packet := self._next():
            if self._random.random() < self.faults.drop:
                continue
            if self._random.random() < self.faults.corrupt:
                packet = self._flipped(packet)
            answers += self._answers(packet, now)
        return answers

    def _next(self) -> bytes:
        """The first whole packet of the buffer, its checksum untried; empty: there is none yet."""
        buffer = self._buffer
        while len(buffer) >= 4:
            # After two FF comes a number below FF and a length of at least two.
            if buffer[0] == buffer[1] == 0xFF and buffer[2] != 0xFF and buffer[3] >= 2:
                if len(buffer) < buffer[3] + 4:
                    return b""
                packet = bytes(buffer[: buffer[3] + 4])
                del buffer[: len(packet)]
                return packet
            del buffer[0]
        return b""

    def _answers(self, packet: bytes, now: float) -> list[Answer]:
        number, instruction, parameters = packet[2], packet[4], packet[5:-1]
        good = sum(packet[2:]) & 0xFF == 0xFF
        self.heard += good
        if number == BROADCAST:
            if good:
                self._broadcast(instruction, parameters)
            return []
        servo = self.servos.get(number)
        if servo is None or not servo.alive:
            return []
        error, data = servo.execute(instruction, parameters) if good else (CHECKSUM, b"")
        level = servo.get("status_return")
        if instruction != PING and (level == 0 or (level == 1 and instruction != READ)):
            return []
        body = bytes([number, len(data) + 2, error]) + data
        status = b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
        return self._sent(status, now + len(packet) * BYTE + servo.get("return_delay") * RETURN_DELAY)

    def _sent(self, status: bytes, now: float) -> list[Answer]:
        if self._random.random() < self.faults.drop:
            return []
        if self._random.random() < self.faults.corrupt:
            status = self._flipped(status)
        late = self._random.uniform(*LATE) if self._random.random() < self.faults.late else 0.0
        return [Answer(now + len(status) * BYTE + self.latency + late, status)]

    def _broadcast(self, instruction: int, parameters: bytes) -> None:
        if instruction != SYNC_WRITE:
            for servo in self.servos.values():
                if servo.alive:
                    servo.execute(instruction, parameters)
            return
        address, size = parameters[:2]
        for place in range(2, len(parameters) - size, size + 1):
            servo = self.servos.get(parameters[place])
            if servo is not None and servo.alive:
                servo.write(address, parameters[place + 1 : place + 1 + size])

    def _flipped(self, packet: bytes) -> bytes:
        place, bit = self._random.integers(2, len(packet)), self._random.integers(8)
        return packet[:place] + bytes([packet[place] ^ 1 << bit]) + packet[place + 1 :]
