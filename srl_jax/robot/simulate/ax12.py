"""A simulated AX-12A: its control table, what it answers to an instruction, and what it asks of its motor.

Written after the data sheet and independent of `robot.bus`, so that a mistake there does not meet its like here.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from srl_jax.robot.table import CENTRE, EEPROM, REGISTERS, SIZE, SPEED, TICK, Register

PING, READ, WRITE, REG_WRITE, ACTION, RESET, SYNC_WRITE = 1, 2, 3, 4, 5, 6, 0x83
VOLTAGE, ANGLE, HEAT, RANGE, CHECKSUM, OVERLOAD, INSTRUCTION = (1 << bit for bit in range(7))
ROOM, WARMTH, SLOWNESS = 25.0, 70.0, 300.0  # degrees around it; degrees above at lasting full torque; s
BATTERY, SAG = 12.0, 1.2  # V at rest, and less of it at full torque of all servos
STARTS = {register.address: register for register in REGISTERS.values()}


class Drive(NamedTuple):
    """What a servo asks of its motor now."""

    on: bool
    goal: float  # rad
    speed: float  # rad/s that the goal is approached with at most; inf: as fast as it can
    torque: float  # share of its torque


class Servo:
    """One servo."""

    def __init__(self, number: int, joint: Callable[[], tuple[float, float, float]] = lambda: (0.0, 0.0, 0.0)) -> None:
        """As it comes from the factory, but for its number.

        Args:
            number: on the line.
            joint: gives its angle (rad), speed (rad/s) and torque as a share of the stall torque.
        """
        self.joint = joint
        self.table = bytearray(SIZE)
        for register in REGISTERS.values():
            self._put(register, register.initial)
        self._put(REGISTERS["id"], number)
        self.number, self.alive, self.heat = number, True, ROOM
        self._error, self._waiting = 0, (0, b"")
        self.drive = self._drive()

    def get(self, name: str) -> int:
        """A register's value."""
        register = REGISTERS[name]
        return int.from_bytes(self.table[register.address : register.address + register.size], "little")

    def warm(self, torque: float, everyone: float, seconds: float) -> None:
        """What time does to it.

        Args:
            torque: share of its stall torque that the motor gives.
            everyone: mean share of all servos, which is what the battery feels.
            seconds: for so long.
        """
        self.heat += seconds / SLOWNESS * (ROOM + WARMTH * torque**2 - self.heat)
        volts = round(10.0 * (BATTERY - SAG * everyone))
        self._put(REGISTERS["present_voltage"], volts)
        self._put(REGISTERS["present_temperature"], round(self.heat))
        hot = self.heat > self.get("temperature_limit")
        low = not self.get("lowest_voltage") <= volts <= self.get("highest_voltage")
        self._error = hot * HEAT | low * VOLTAGE
        if self._error & self.get("shutdown") and self.drive.on:  # it gives up by itself
            self._put(REGISTERS["torque_enable"], 0)
            self._put(REGISTERS["torque_limit"], 0)
            self.drive = self._drive()

    def _look(self) -> None:
        angle, speed, torque = self.joint()
        self._put(REGISTERS["present_position"], min(max(CENTRE + round(angle / TICK), 0), 1023))
        self._put(REGISTERS["present_speed"], _magnitude(speed / SPEED))
        self._put(REGISTERS["present_load"], _magnitude(torque * 1023.0))
        self._put(REGISTERS["moving"], int(abs(speed) > 0.1))

    def execute(self, instruction: int, parameters: Sequence[int]) -> tuple[int, bytes]:
        """Does what it is told; error bits and data of the answer."""
        error, data = 0, b""
        if instruction == READ and len(parameters) == 2:
            first, count = parameters
            if first + count > SIZE:
                error = RANGE
            else:
                self._look()
                data = bytes(self.table[first : first + count])
        elif instruction == WRITE and len(parameters) > 1:
            error = self.write(parameters[0], bytes(parameters[1:]))
        elif instruction == REG_WRITE and len(parameters) > 1:
            self._waiting = (parameters[0], bytes(parameters[1:]))
            self._put(REGISTERS["registered"], 1)
        elif instruction == ACTION:
            error = self.write(*self._waiting) if self._waiting[1] else INSTRUCTION
            self._waiting = (0, b"")
            self._put(REGISTERS["registered"], 0)
        elif instruction != PING:
            error = INSTRUCTION
        return error | self._error, data

    def write(self, address: int, data: bytes) -> int:
        """Writes bytes to the table, all or nothing; error bits."""
        if address + len(data) > SIZE:
            return RANGE
        if self.get("lock") and address < EEPROM:
            return RANGE
        place, values = address, {}
        while place < address + len(data):
            register = STARTS.get(place)
            if register is None or place + register.size > address + len(data):
                return RANGE
            value = int.from_bytes(data[place - address :][: register.size], "little")
            if not register.writable or not register.least <= value <= register.most:
                return RANGE
            values[place] = value
            place += register.size
        goal = values.get(REGISTERS["goal_position"].address)
        if goal is not None and not self.get("cw_limit") <= goal <= self.get("ccw_limit"):
            return ANGLE
        for where, value in values.items():
            self._put(STARTS[where], value)
        if goal is not None and REGISTERS["torque_enable"].address not in values:
            self._put(REGISTERS["torque_enable"], 1)  # as theirs do
        self.drive = self._drive()
        return 0

    def _drive(self) -> Drive:
        speed = self.get("moving_speed")
        return Drive(
            on=bool(self.get("torque_enable")) and self.get("torque_limit") > 0,
            goal=(self.get("goal_position") - CENTRE) * TICK,
            speed=speed * SPEED if speed else math.inf,
            torque=min(self.get("torque_limit"), self.get("max_torque")) / 1023.0,
        )

    def _put(self, register: Register, value: int) -> None:
        self.table[register.address : register.address + register.size] = value.to_bytes(register.size, "little")


def _magnitude(value: float) -> int:
    """A number of ten bits, and an eleventh that says clockwise."""
    return min(round(abs(value)), 1023) | (0x400 if value < 0.0 else 0)
