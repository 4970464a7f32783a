"""From angles to steps of a servo and back, and what a command must pass before it is sent."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from srl_jax.env.anatomy import JOINTS
from srl_jax.env.interface import CONTROL_HZ, RANGE, STANCE
from srl_jax.robot.table import CENTRE, IDS, NO_LOAD, SPEED, STEPS, TICK

STIFFNESS = 12.0  # N m/rad, of the servo that policies know
# What a servo moves in a control step at most, and beyond it the error at which its torque is all it has: a command
# further ahead changes nothing of what the servo does now, but much of where it ends should it be the last.
RATE = NO_LOAD + CONTROL_HZ * 1.5 / STIFFNESS  # rad/s
STANDING = np.tile(STANCE, 6)  # f64[18] rad


@dataclass(frozen=True)
class Calibration:
    """Which servo is which joint, at what step it is at 0 rad, and whether its steps grow with the angle."""

    ids: tuple[int, ...] = IDS  # by joint
    zero: np.ndarray = field(default_factory=lambda: np.full(18, CENTRE))  # i[18] steps
    sign: np.ndarray = field(default_factory=lambda: np.ones(18, int))  # i[18] of +1, -1

    def steps(self, angles: np.ndarray) -> np.ndarray:
        """Goal positions i[18] of angles f[18] (rad), within what a servo has."""
        wanted = self.zero + self.sign * np.round(np.asarray(angles) / TICK).astype(int)
        return np.clip(wanted, 0, STEPS - 1)

    def angle(self, joint: int, position: int) -> float:
        """Radians of one joint at a position."""
        return float(self.sign[joint] * (position - self.zero[joint]) * TICK)

    def speed(self, joint: int, steps: int) -> float:
        """rad/s of one joint."""
        return float(self.sign[joint] * steps * SPEED)

    def ranges(self) -> dict[int, tuple[int, int]]:
        """Least and most goal position of every servo: the joint's working range."""
        ends = np.sort(np.stack([self.steps(LOW), self.steps(HIGH)]), axis=0)
        return {number: (int(a), int(b)) for number, a, b in zip(self.ids, *ends, strict=True)}


LOW, HIGH = -np.radians(np.tile(RANGE, 6)), np.radians(np.tile(RANGE, 6))  # f64[18] rad


def load(path: str) -> Calibration:
    """A calibration file: JSON, for joints that differ from the kit, ``{"tibia_rf": {"zero": 498, "sign": -1}}``.

    Args:
        path: of the file; empty: the kit as it is.

    Raises:
        ValueError: it cannot be read, names no joint, or a value is out of range.
    """
    ids, zero, sign = list(IDS), np.full(18, CENTRE), np.ones(18, int)
    accepted = {"id": (ids, range(254)), "zero": (zero, range(STEPS)), "sign": (sign, (-1, 1))}
    try:
        said = json.loads(Path(path).read_text()) if path else {}
        entries = [(joint, name, value) for joint, own in said.items() for name, value in own.items()]
    except (OSError, ValueError, AttributeError) as error:
        raise ValueError(f"calibration is {path}: it is no JSON object of joints ({error}).") from None
    for joint, name, value in entries:
        if joint not in JOINTS or name not in accepted or type(value) is not int or value not in accepted[name][1]:
            raise ValueError(
                f"calibration {path} says {joint}: {name} {value}; accepted are joints such as tibia_rf with id (0 to "
                f"253), zero (0 to {STEPS - 1}) and sign (-1 or 1)."
            )
        accepted[name][0][JOINTS.index(joint)] = value
    if len(set(ids)) < len(ids):
        raise ValueError(f"calibration {path} gives one id to two joints: {', '.join(map(str, ids))}.")
    return Calibration(tuple(ids), zero, sign)


@dataclass(frozen=True)
class Gains:
    """Of the host's servo, beside the servo's own; all 0: the wanted angle is the command."""

    p: float = 0.0
    i: float = 0.0  # 1/s
    d: float = 0.0  # s
    windup: float = 0.2  # rad that the integral part gives at most


class Servos:
    """The host's position servo of 18 joints: PID about the wanted angle, then working range, then rate."""

    def __init__(self, gains: Gains = Gains(), rate: float = RATE) -> None:
        """Servos that have not moved yet.

        Args:
            gains: of all joints.
            rate: rad/s; no command is further from where its joint is than this times the period.
        """
        self.gains, self.rate = gains, rate
        self._sum = np.zeros(18)

    def command(self, wanted: np.ndarray, angles: np.ndarray, speeds: np.ndarray, period: float) -> np.ndarray:
        """Angles f64[18] (rad) to send.

        Args:
            wanted: f[18] rad.
            angles, speeds: f[18] rad and rad/s, where the joints are.
            period: s since the last command.

        Raises:
            ValueError: a wanted angle is not finite.
        """
        if not np.isfinite(wanted).all():
            bad = [name for name, value in zip(JOINTS, wanted, strict=True) if not np.isfinite(value)]
            raise ValueError(f"wanted angle of {', '.join(bad)} is no number; nothing is sent.")
        error = np.asarray(wanted) - angles
        gains = self.gains
        self._sum = np.clip(self._sum + gains.i * period * error, -gains.windup, gains.windup)
        command = wanted + gains.p * error + self._sum - gains.d * speeds
        reach = self.rate * period
        return np.clip(np.clip(command, angles - reach, angles + reach), LOW, HIGH)
