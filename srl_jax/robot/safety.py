"""When a robot must stop, and how it stands up and lies down."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from srl_jax.env.anatomy import JOINTS
from srl_jax.robot.clock import Clock
from srl_jax.robot.hexapod import PERIOD, Hexapod, Sensed
from srl_jax.robot.servo import STANDING

FEMURS, COXAE, TIBIAE = (tuple(range(first, 18, 3)) for first in (1, 0, 2))
LIFTED = 1.1  # rad of a femur whose foot is off the ground while the belly lies on it
SLOW, TOGETHER = 2.0, 1.2  # rad/s of one joint alone, and of all femurs under load
ROUND = 0.8  # share of a period in which servos are read while nothing hurries


class StoppedError(Exception):
    """The robot must not go on; says why."""


class TippedError(StoppedError):
    """It has tipped over, which somebody may put right."""


@dataclass(frozen=True)
class Limits:
    """Beyond which the torque is taken off at once."""

    tilt: float = 0.5  # cosine between the robot's and the world's up: 60 degrees
    temperature: int = 68  # degrees; servos give up by themselves at 70
    voltage: float = 9.6  # V: 3.2 a cell of three
    quiet: float = 0.2  # s without a line of the inertial unit
    patience: int = 3  # rounds that tilt and voltage must last


class Watch:
    """Looks at every round."""

    def __init__(self, limits: Limits = Limits()) -> None:
        self.limits = limits
        self._tilted = self._low = 0

    def check(self, sensed: Sensed) -> None:
        """Counts what is out of limits.

        Raises:
            StoppedError: the robot has tipped, is hot, has little voltage, or its inertial unit is silent.
        """
        limits, upright = self.limits, -float(sensed.senses.gravity[2])
        self._tilted = self._tilted + 1 if upright < limits.tilt else 0
        self._low = self._low + 1 if sensed.voltage < limits.voltage else 0
        if self._tilted >= limits.patience:
            raise TippedError(f"it has tipped over: upright is {upright:.2f}, at least {limits.tilt} is accepted")
        if self._low >= limits.patience:
            raise StoppedError(f"voltage is {sensed.voltage:.1f} V, at least {limits.voltage} is accepted")
        if sensed.temperature > limits.temperature:
            raise StoppedError(f"{sensed.hottest} has {sensed.temperature} degrees, {limits.temperature} are accepted")
        if sensed.quiet > limits.quiet:
            raise StoppedError(f"the inertial unit has said nothing for {sensed.quiet:.2f} s")
        if "overheating" in sensed.alarm or "overload" in sensed.alarm:
            raise StoppedError(f"a servo has given up: {sensed.alarm}")


@dataclass
class Poses:
    """Moves a robot slowly from pose to pose, under the watch."""

    robot: Hexapod
    clock: Clock
    watch: Watch
    stop: Callable[[], bool]  # whether somebody wants it to stop

    def rise(self, torque: float = 1.0) -> Sensed:
        """From wherever its legs are to the stance: every joint alone, then all femurs together.

        Args:
            torque: share of a servo's torque that it may use.

        Returns:
            What it felt last.

        Raises:
            ValueError: no servo answers, or one is set to turn endlessly.
            StoppedError: as `Watch.check`, or somebody wants it to stop.
            BusLostError: the bus has gone.
        """
        self._set_up(torque)
        sensed = self._sense()
        wanted = sensed.angles.copy()
        self.robot.send(self.robot.calibration.steps(wanted))  # stays where it is
        ids = self.robot.calibration.ids
        steps = [(joint, LIFTED) for joint in FEMURS] + [(joint, STANDING[joint]) for joint in COXAE + TIBIAE]
        for joint, angle in steps:
            if self.robot.alive[joint]:
                self.robot.bus.write(ids[joint], "torque_enable", 1)
                sensed = self._move(wanted, [joint], angle, SLOW)
        return self._move(wanted, FEMURS, STANDING[FEMURS[0]], TOGETHER)

    def stand(self) -> Sensed:
        """From a pose of its walk to the stance, all joints together; errors as `rise`, and what it felt last."""
        return self._move(self._sense().angles.copy(), range(18), STANDING, TOGETHER)

    def lie_down(self) -> None:
        """From any pose onto the belly, then without torque. What stops others does not stop this, a lost bus does."""
        self.watch = Watch(Limits(tilt=-1.0, temperature=999, voltage=0.0, quiet=np.inf))
        self.stop = lambda: False
        try:
            self._move(self._sense().angles.copy(), FEMURS, LIFTED, 2.0 * TOGETHER)
        except StoppedError:
            pass  # a servo has given up: the others are let go as well
        finally:
            self.robot.bus.limp()

    def _set_up(self, torque: float) -> None:
        robot, bus = self.robot, self.robot.bus
        robot.find()
        bus.limp()
        for joint, number in enumerate(robot.calibration.ids):
            if not robot.alive[joint]:
                continue
            if bus.read(number, "cw_limit") == bus.read(number, "ccw_limit") == 0:
                raise ValueError(f"servo {number} ({JOINTS[joint]}) is set to turn endlessly: set its angle limits.")
            if bus.read(number, "return_delay") != 0:
                bus.write(number, "return_delay", 0)  # in its EEPROM, once and for all
            bus.write(number, "moving_speed", 0)
            bus.write(number, "torque_limit", round(1023 * torque))

    def _sense(self) -> Sensed:
        now = self.clock.now()
        sensed = self.robot.sense(now + ROUND * PERIOD, now + PERIOD)
        self.watch.check(sensed)
        if self.stop():
            raise StoppedError("it was asked to")
        return sensed

    def _move(self, wanted: np.ndarray, joints: Sequence[int], angle: float | np.ndarray, speed: float) -> Sensed:
        """Leads joints to an angle, or each to its own; `wanted` f[18] follows. Commands are near to them."""
        moving = list(joints)
        while True:
            began = self.clock.now()
            sensed = self._sense()
            wanted[moving] += np.clip(angle - wanted[moving], -speed * PERIOD, speed * PERIOD)
            self.robot.send(self.robot.command(wanted, sensed))
            self.clock.sleep_until(began + PERIOD)
            if np.all(wanted[moving] == angle):
                return sensed
