"""An outing of the robot, told as it goes: what `deploy` prints, and the log that it leaves."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from srl_jax import __version__
from srl_jax.cli.deploy_options import Arguments
from srl_jax.portable import Policy
from srl_jax.robot import log, outing, servo
from srl_jax.robot.bus import Bus
from srl_jax.robot.clock import Clock, RealClock
from srl_jax.robot.dry import DryBus
from srl_jax.robot.guard import Guard
from srl_jax.robot.hexapod import Hexapod, Sensed
from srl_jax.robot.imu import Imu
from srl_jax.robot.lessons import Lessons
from srl_jax.robot.loop import Loop, Outcome
from srl_jax.robot.policy import Walker
from srl_jax.robot.ports import BusLostError, LinePort, SerialPort
from srl_jax.robot.safety import Poses, Watch

if TYPE_CHECKING:
    from srl_jax.robot.simulate.child import Simulated


class Learning(Protocol):
    """What makes lessons of a walk."""

    def student(self, clock: Clock) -> Walker:
        """Who walks."""
        ...

    def lessons(
        self, poses: Poses, note: Callable[[log.Entry], None], react: Callable[[float, Sensed], None]
    ) -> Lessons:
        """Episodes of the student."""
        ...


class Told:
    """Exchanges policies and lets the simulated damage strike as the walk goes on, and says so."""

    def __init__(self, walker: Walker, repertoire: dict[str, Policy], robot: Hexapod) -> None:
        self.walker, self.repertoire, self.robot = walker, repertoire, robot
        self.strike: tuple[float, Simulated] | None = None  # s of walking
        self._known: tuple[str, ...] = ()

    def react(self, now: float, sensed: Sensed) -> None:
        """Called at every step, `now` seconds after the first."""
        if self.strike and now >= self.strike[0]:
            self.strike[1].strike()
            self.strike = None
        if self.robot.dead != self._known:
            self._known = self.robot.dead
            damage = outing.damage_of(self._known)
            said = f"{now:6.2f} s: no answer from {', '.join(self._known)}"
            if policy := self.repertoire.get(damage):
                self.walker.swap(policy)
                said += f"; on by the policy for {damage}"
            print(f"{said}.", flush=True)


def go(
    arguments: Arguments,
    bus_name: str,
    imu_name: str,
    repertoire: dict[str, Policy],
    simulated: "Simulated | None",
    stop: Callable[[], bool],
    learning: Learning | None = None,
) -> int:
    """Walks as the arguments say, and learns where it is to; exit code 1 where it ended before its time.

    Raises:
        ValueError: a port cannot be opened, or nobody answers.
    """
    calibration, clock, watch = servo.load(arguments.calibration), RealClock(), Watch()
    port = SerialPort(bus_name, clock)
    port.openPort()
    bus = (DryBus if arguments.dry_run else Bus)(port, calibration.ranges())
    imu = Imu(LinePort(imu_name), clock, arguments.imu_axes) if imu_name else None
    robot = Hexapod(bus, imu, calibration, servo.Servos())
    first, policy = next(iter(repertoire.items()))
    walker = learning.student(clock) if learning else Walker(policy)
    about = {"policy": arguments.behaviour or arguments.policy, "trained_for": first, "version": __version__}
    writer = log.Writer(Path(arguments.log), about)
    told = Told(walker, {} if learning else repertoire, robot)
    if simulated and arguments.strike:
        told.strike = (arguments.strike, simulated)
    poses = Poses(robot, clock, watch, stop)
    walk = Loop(robot, walker, clock, watch, stop, writer.add, told.react)
    if learning:
        walk = learning.lessons(poses, writer.add, told.react)
    guard = None if arguments.dry_run else Guard(bus_name)
    places: list[Any] = []
    try:
        reason = outing.go(
            poses,
            walk,
            arguments.seconds,
            torque=arguments.torque,
            stood=lambda: places.append(_stood(robot, simulated)),
        )
    finally:
        writer.close()
        if guard:
            guard.dismiss()
        with suppress(BusLostError, OSError):
            port.closePort()
    _tell(walk.outcome, robot, places, simulated)
    print(f"Log: {arguments.log}")
    if reason:
        print(f"It ended before its time: {reason}.")
    return int(bool(reason))


def _stood(robot: Hexapod, simulated: "Simulated | None") -> Any:
    """Called when the robot stands; where it does, if anybody knows."""
    missing = f"; no answer from {', '.join(robot.dead)}" if robot.dead else ""
    print(f"It stands on {int(robot.alive.sum())} servos{missing}.", flush=True)
    return simulated.report()["place"] if simulated else None


def _tell(outcome: Outcome, robot: Hexapod, places: list[Any], simulated: "Simulated | None") -> None:
    steps, counts = len(outcome.late), robot.bus.counts
    if steps:
        far = ""
        if simulated and places:
            report = simulated.report()
            far = f", {float(np.hypot(*np.subtract(report['place'], places[0])[:2])):.2f} m"
            print(f"The simulation was kept from running for {1e3 * report['stall']:.0f} ms at worst.")
        print(f"It walked {outcome.seconds:.1f} s{far}, {steps} steps.")
        print(
            f"Goals went out late by {1e3 * outcome.jitter(0.5):.2f} ms (p50), {1e3 * outcome.jitter(0.99):.2f} (p99), "
            f"{1e3 * max(outcome.late):.2f} (worst); {outcome.overruns} overruns, {outcome.skipped} deadlines skipped."
        )
    print(
        f"Packets: {counts.asked} asked for an answer, {counts.silent} had none, {counts.corrupt} a broken one "
        f"({counts.lost:.1%} lost); {outcome.missed} readings foretold."
    )
    print(f"Silent joints: {', '.join(robot.dead) or 'none'}.")
