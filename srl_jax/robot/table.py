"""The AX-12A as its data sheet has it: control table, units, and which servo is which joint of a PhantomX."""

import math
from typing import NamedTuple

from srl_jax.env.anatomy import JOINTS, LEGS

TICK = math.radians(300.0 / 1024.0)  # rad of one step of position
CENTRE, STEPS = 512, 1024  # the position that is 0 rad, and how many there are
SPEED = 0.111 * 2.0 * math.pi / 60.0  # rad/s of one step of speed
STALL = 1.5  # N m at 12 V
NO_LOAD = 6.18  # rad/s
RETURN_DELAY = 2e-6  # s of one step
BAUD = 1_000_000
BROADCAST = 0xFE
ERRORS = ("voltage", "angle limit", "overheating", "range", "checksum", "overload", "instruction")  # bit 0 first

# As the PhantomX's own firmware counts its servos: coxa, femur, tibia of every leg.
LEG_IDS = {
    "rf": (2, 4, 6),
    "rm": (14, 16, 18),
    "rr": (8, 10, 12),
    "lf": (1, 3, 5),
    "lm": (13, 15, 17),
    "lr": (7, 9, 11),
}
IDS = tuple(number for leg in LEGS for number in LEG_IDS[leg])  # in the order of `JOINTS`
JOINT_OF = dict(zip(IDS, JOINTS, strict=True))


class Register(NamedTuple):
    """One entry of the control table; two bytes are low byte first."""

    address: int
    size: int
    least: int
    most: int
    initial: int
    writable: bool = True


REGISTERS = {
    "model": Register(0, 2, 0, 0xFFFF, 12, False),
    "firmware": Register(2, 1, 0, 255, 24, False),
    "id": Register(3, 1, 0, 253, 1),
    "baud": Register(4, 1, 0, 254, 1),
    "return_delay": Register(5, 1, 0, 254, 250),
    "cw_limit": Register(6, 2, 0, 1023, 0),
    "ccw_limit": Register(8, 2, 0, 1023, 1023),
    "temperature_limit": Register(11, 1, 0, 100, 70),
    "lowest_voltage": Register(12, 1, 50, 160, 60),
    "highest_voltage": Register(13, 1, 50, 160, 140),
    "max_torque": Register(14, 2, 0, 1023, 1023),
    "status_return": Register(16, 1, 0, 2, 2),
    "alarm_led": Register(17, 1, 0, 127, 36),
    "shutdown": Register(18, 1, 0, 127, 36),
    "torque_enable": Register(24, 1, 0, 1, 0),
    "led": Register(25, 1, 0, 1, 0),
    "cw_margin": Register(26, 1, 0, 255, 1),
    "ccw_margin": Register(27, 1, 0, 255, 1),
    "cw_slope": Register(28, 1, 0, 255, 32),
    "ccw_slope": Register(29, 1, 0, 255, 32),
    "goal_position": Register(30, 2, 0, 1023, 512),
    "moving_speed": Register(32, 2, 0, 1023, 0),
    "torque_limit": Register(34, 2, 0, 1023, 1023),
    "present_position": Register(36, 2, 0, 1023, 512, False),
    "present_speed": Register(38, 2, 0, 2047, 0, False),
    "present_load": Register(40, 2, 0, 2047, 0, False),
    "present_voltage": Register(42, 1, 0, 255, 120, False),
    "present_temperature": Register(43, 1, 0, 255, 25, False),
    "registered": Register(44, 1, 0, 1, 0),
    "moving": Register(46, 1, 0, 1, 0, False),
    "lock": Register(47, 1, 0, 1, 0),
    "punch": Register(48, 2, 32, 1023, 32),
}
SIZE = 50  # bytes of the table
EEPROM = 24  # registers below this address keep their value, and cannot be written while the torque is on


def bytes_of(name: str, value: int) -> list[int]:
    """A register's value as bytes, low byte first."""
    return list(value.to_bytes(REGISTERS[name].size, "little"))


def signed(value: int) -> int:
    """Speed or load of 11 bits, whose highest is set where it goes clockwise, as a number."""
    return -(value & 0x3FF) if value & 0x400 else value & 0x3FF


def named(error: int) -> str:
    """The error bits of a status packet in words; empty for none."""
    return ", ".join(name for bit, name in enumerate(ERRORS) if error >> bit & 1)
