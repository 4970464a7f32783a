"""Eighteen servos and an inertial unit as one robot: what it feels, what it is told, and which joints it has lost."""

from typing import NamedTuple

import numpy as np

from srl_jax.env.anatomy import JOINTS
from srl_jax.env.interface import CONTROL_HZ
from srl_jax.env.senses import Senses
from srl_jax.robot.bus import Bus, Reading
from srl_jax.robot.imu import Imu
from srl_jax.robot.ports import BusLostError
from srl_jax.robot.servo import STANDING, Calibration, Servos
from srl_jax.robot.table import named

PERIOD = 1.0 / CONTROL_HZ
TRIES = 5  # without an answer, beside that, for a line that is busy now and then may hit the same servo thrice
MISSED = 3  # rounds without an answer until a joint counts as lost; from the one before it is asked three times
SILENT = 2  # rounds without any answer until the bus does
ENOUGH = 4  # servos, not doubted before, whose common silence is the bus's
AHEAD = 2.0 * PERIOD  # s that a joint is taken to move on after its last reading


class Sensed(NamedTuple):
    """One round."""

    senses: Senses
    angles: np.ndarray  # f64[18] rad, foretold for the moment that was asked for
    speeds: np.ndarray  # f64[18] rad/s
    missed: int  # servos that are there and were not heard in this round
    voltage: float  # V, of those that were heard; the last known where nobody was
    temperature: int  # degrees, the hottest
    hottest: str  # whose that is
    alarm: str  # error bits of servos in words
    quiet: float  # s since the inertial unit's last line
    died: tuple[str, ...]  # joints that are lost since this round


class Hexapod:
    """The robot behind a bus and a stream of inertial lines."""

    def __init__(self, bus: Bus, imu: Imu | None, calibration: Calibration, servos: Servos) -> None:
        """A robot nothing is known of yet.

        Args:
            bus: on an open port.
            imu: None: it is taken to be level, and to keep its heading.
            calibration: of its servos.
            servos: the host's.
        """
        self.bus, self.imu, self.calibration, self.servos = bus, imu, calibration, servos
        self.alive = np.ones(18, bool)
        self.sent = np.full(18, -1)  # i[18] last goal positions
        self._missed, self._tries = np.zeros(18, int), np.zeros(18, int)  # rounds and questions without an answer
        self._silent = 0
        self._last: list[Reading | None] = [None] * 18

    @property
    def dead(self) -> tuple[str, ...]:
        """Joints whose servos do not answer."""
        return tuple(name for name, there in zip(JOINTS, self.alive, strict=True) if not there)

    def find(self) -> None:
        """Asks every servo whether it is there.

        Raises:
            ValueError: not one of them answers.
        """
        self.alive = np.array([self.bus.ping(number) for number in self.calibration.ids])
        if not self.alive.any():
            raise ValueError(
                f"port is {self.bus.port.port_name}: none of the servos {min(self.calibration.ids)} to "
                f"{max(self.calibration.ids)} answers; look to power, wiring, and their baud rate of 1 Mbps."
            )

    def sense(self, until: float, at: float) -> Sensed:
        """Reads who is there, and foretells where the joints are at a moment.

        Args:
            until: moment at which no more servos are asked.
            at: moment that angles are foretold for.

        Raises:
            BusLostError: the port has gone, or nobody has answered for two rounds.
        """
        ids = self.calibration.ids
        here = [joint for joint in range(18) if self.alive[joint]]
        doubted = {ids[joint] for joint in here if self._missed[joint] >= MISSED - 1}
        found, asked = self.bus.round([ids[joint] for joint in here], until, doubted)
        if found:
            self._silent = 0
        elif len(set(asked) - doubted) >= ENOUGH:
            self._silent += 1
        if self._silent >= SILENT:
            raise BusLostError("no servo answers any more")
        died = []
        for joint in here:
            if ids[joint] in found:
                self._last[joint] = found[ids[joint]]
                self._missed[joint] = self._tries[joint] = 0
            elif ids[joint] in asked and 2 * len(found) >= len(asked):  # else it is the bus
                self._missed[joint] += 1
                self._tries[joint] += asked[ids[joint]]
                if self._missed[joint] >= MISSED and self._tries[joint] >= TRIES:
                    self.alive[joint] = False
                    died.append(JOINTS[joint])
        if self.imu is not None:
            self.imu.poll()
        return self._sensed(found, len(here), at, tuple(died))

    def command(self, wanted: np.ndarray, sensed: Sensed) -> np.ndarray:
        """The goal positions i[18] that wanted angles f[18] (rad) become; nothing is sent."""
        return self.calibration.steps(self.servos.command(wanted, sensed.angles, sensed.speeds, PERIOD))

    def send(self, goals: np.ndarray) -> None:
        """Sends goal positions i[18] to the servos that are there, in one packet, sent twice: nobody confirms it."""
        ids = self.calibration.ids
        for _ in range(2):
            self.bus.write_all("goal_position", {ids[j]: int(goals[j]) for j in range(18) if self.alive[j]})
        self.sent = np.array(goals)

    def _sensed(self, found: dict[int, Reading], asked: int, at: float, died: tuple[str, ...]) -> Sensed:
        angles, speeds = STANDING.copy(), np.zeros(18)  # where nobody has said otherwise
        for joint, reading in enumerate(self._last):
            if reading is not None and self.alive[joint]:
                speeds[joint] = self.calibration.speed(joint, reading.speed)
                angles[joint] = self.calibration.angle(joint, reading.position)
                angles[joint] += speeds[joint] * min(max(at - reading.time, 0.0), AHEAD)
        known = {joint: x for joint, x in enumerate(self._last) if x is not None and self.alive[joint]}
        hottest = max(known, key=lambda joint: known[joint].temperature, default=0)
        gravity, rate, heading, quiet = np.array([0.0, 0.0, -1.0]), np.zeros(3), 0.0, 0.0
        if self.imu is not None:
            gravity, rate, heading, quiet = self.imu.gravity, self.imu.rate, self.imu.heading, self.imu.silence
        senses = Senses(
            joints=np.where(self.alive, angles - STANDING, 0.0).astype(np.float32),
            speeds=np.where(self.alive, speeds, 0.0).astype(np.float32),
            answering=self.alive.copy(),
            gyroscope=rate.astype(np.float32),
            gravity=gravity.astype(np.float32),
            towards=np.array([np.cos(heading), -np.sin(heading)], np.float32),
            distance=np.array(2.0, np.float32),
            come=np.array(np.nan, np.float32),
        )
        alarms = {JOINTS[joint]: named(x.error) for joint, x in known.items() if x.error}
        return Sensed(
            senses,
            angles,
            speeds,
            missed=asked - len(found),
            voltage=float(np.median([reading.voltage for reading in known.values()] or [np.nan])),
            temperature=max((reading.temperature for reading in known.values()), default=0),
            hottest=JOINTS[hottest],
            alarm="; ".join(f"{name}: {words}" for name, words in alarms.items()),
            quiet=quiet,
            died=died,
        )
