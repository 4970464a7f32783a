"""The servos' bus: Dynamixel protocol 1.0 through the SDK, with writes that are checked before they are sent.

AX-12A know neither bulk nor sync reads, so a round is one read a servo: position, speed, load, voltage and temperature
lie side by side and come in one answer. A round ends at its deadline: who was not reached is read first in the next.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_SUCCESS, GroupSyncWrite, Protocol1PacketHandler

from srl_jax.robot.ports import Port
from srl_jax.robot.table import BROADCAST, REGISTERS, bytes_of, signed

PRESENT = (REGISTERS["present_position"].address, 8)  # up to and with the temperature
TRIES = 3  # of what is not a round
# s that an answer has where nothing hurries. Answers do not say what they answer: one that came after its time would be
# taken for that to the next question. In a round all questions are the same, and it is no more than old.
PATIENCE = 0.05


class Reading(NamedTuple):
    """What one servo says of itself."""

    position: int  # steps
    speed: int  # steps of .111 rpm, clockwise negative
    load: int  # of 1023, clockwise negative
    voltage: float  # V
    temperature: int  # degrees Celsius
    error: int  # bits
    time: float  # s, when it was asked


class Round(NamedTuple):
    """Who was asked, and what they said."""

    found: dict[int, Reading]
    asked: dict[int, int]  # how often; who is missing was not reached in time


@dataclass
class Counts:
    """Packets so far."""

    asked: int = 0  # packets that want an answer
    silent: int = 0  # that had none in time
    corrupt: int = 0  # whose answer was none

    @property
    def lost(self) -> float:
        """The share of answers that did not come, or came broken."""
        return (self.silent + self.corrupt) / max(self.asked, 1)


class Bus:
    """One port and the servos on it."""

    def __init__(self, port: Port, ranges: Mapping[int, tuple[int, int]]) -> None:
        """A bus on an open port.

        Args:
            port: opened.
            ranges: least and most goal position of every servo that may be written to, in steps.
        """
        self.port, self.ranges, self.counts = port, dict(ranges), Counts()
        self._packets = Protocol1PacketHandler()
        self._next = 0  # the servo with which the next round begins

    def ping(self, number: int) -> bool:
        """Whether a servo answers, asked up to nine times: who is taken for lost here is lost for the whole walk."""
        return any(self.read(number, "id") == number for _ in range(TRIES))

    def read(self, number: int, name: str) -> int | None:
        """A register's value; None: no answer after three tries."""
        register = REGISTERS[name]
        with self._patience():
            for _ in range(TRIES):
                found = self._read(number, register.address, register.size)
                if found is not None:
                    return int.from_bytes(found[0], "little")
        return None

    def write(self, number: int, name: str, value: int) -> bool:
        """Writes a register; whether the servo has confirmed it, asked up to three times.

        Raises:
            ValueError: no such servo or register, one that is read only, or a value out of range; nothing is sent.
        """
        self._check(number, name, value)
        register = REGISTERS[name]
        data = bytes_of(name, value)
        with self._patience():
            for _ in range(TRIES):
                result, _ = self._asked(self._packets.writeTxRx, number, register.address, register.size, data)
                if result == COMM_SUCCESS:
                    return True
        return False

    def write_all(self, name: str, values: Mapping[int, int]) -> None:
        """Writes a register of many servos in one packet, which nobody answers.

        Raises:
            ValueError: as `write`, for any of them; nothing is sent.
        """
        for number, value in values.items():
            self._check(number, name, value)
        register = REGISTERS[name]
        group = GroupSyncWrite(self.port, self._packets, register.address, register.size)
        for number, value in values.items():
            group.addParam(number, bytes_of(name, value))
        self.port.is_using = False
        group.txPacket()

    def limp(self, times: int = 3) -> None:
        """Takes the torque off all servos, whoever they are, in one packet, which is sent more than once."""
        register = REGISTERS["torque_enable"]
        for _ in range(times):
            self.port.is_using = False
            self._packets.writeTxOnly(self.port, BROADCAST, register.address, register.size, [0])

    def round(self, numbers: Iterable[int], until: float, doubted: Collection[int] = ()) -> Round:
        """Reads servos one after the other, and those that did not answer once more, while there is time.

        Args:
            numbers: of the servos.
            until: moment of the port's clock at which no more are asked.
            doubted: those of them that are asked three times, for they were silent before; after the others, whom
                their silence must not keep waiting.
        """
        order = list(numbers)
        start = next((place for place, number in enumerate(order) if number == self._next), 0)
        order = order[start:] + order[:start]
        found: dict[int, Reading] = {}
        asked: dict[int, int] = {}
        sure = [number for number in order if number not in doubted]
        plan = sure + [number for number in order if number in doubted] * TRIES + sure
        for number in plan:
            if number in found or asked.get(number, 0) >= (TRIES if number in doubted else 2):
                continue
            if self.port.clock.now() >= until:
                self._next = number
                break
            asked[number] = asked.get(number, 0) + 1
            reading = self._present(number)
            if reading is not None:
                found[number] = reading
        return Round(found, asked)

    @contextmanager
    def _patience(self) -> Iterator[None]:
        usual, self.port.answer = self.port.answer, PATIENCE
        try:
            yield
        finally:
            self.port.answer = usual

    def _present(self, number: int) -> Reading | None:
        now = self.port.clock.now()
        answer = self._read(number, *PRESENT)
        if answer is None:
            return None
        data, error = answer
        position, speed, load = (data[place] | data[place + 1] << 8 for place in (0, 2, 4))
        return Reading(position & 0x3FF, signed(speed), signed(load), data[6] / 10.0, data[7], error, now)

    def _read(self, number: int, address: int, size: int) -> tuple[bytes, int] | None:
        """What lies in the table, and the error bits."""
        data, result, error = self._asked(self._packets.readTxRx, number, address, size)
        return (bytes(data), error) if result == COMM_SUCCESS else None

    def _asked(self, ask, number: int, *arguments):
        """Calls one of the SDK's functions, and counts what comes of it."""
        self.counts.asked += 1
        self.port.is_using = False  # of a packet that was broken off
        *data, result, error = ask(self.port, number, *arguments)
        if result == COMM_SUCCESS and data and len(data[0]) != arguments[1]:
            result = COMM_RX_CORRUPT  # an answer to something else
        self.counts.corrupt += result == COMM_RX_CORRUPT
        self.counts.silent += result not in (COMM_RX_CORRUPT, COMM_SUCCESS)
        return (*data, result, error)

    def _check(self, number: int, name: str, value: int) -> None:
        if number not in self.ranges:
            raise ValueError(f"servo is {number}: accepted are {', '.join(map(str, sorted(self.ranges)))}.")
        register = REGISTERS.get(name)
        if register is None or not register.writable:
            own = [key for key, entry in REGISTERS.items() if entry.writable]
            raise ValueError(f"register is {name!r}: those that can be written are {', '.join(own)}.")
        least, most = self.ranges[number] if name == "goal_position" else (register.least, register.most)
        if type(value) is not int or not least <= value <= most:
            raise ValueError(f"{name} of servo {number} is {value}: accepted are whole numbers from {least} to {most}.")
