"""Learning while the robot walks: what `deploy --learn` does beside an outing."""

import dataclasses
import select
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from srl_jax.cli import deploy_story
from srl_jax.cli.deploy_options import Arguments
from srl_jax.cli.signals import StopSignals
from srl_jax.job.course import STATE, STUDENT, Course
from srl_jax.job.learning import Remote
from srl_jax.portable import Policy
from srl_jax.robot import log
from srl_jax.robot.clock import Clock
from srl_jax.robot.hexapod import Sensed
from srl_jax.robot.lessons import Lessons
from srl_jax.robot.odometer import Odometer
from srl_jax.robot.ports import LinePort
from srl_jax.robot.safety import Poses, StoppedError
from srl_jax.robot.student import Episode, Student

if TYPE_CHECKING:
    from srl_jax.robot.simulate.child import Simulated


class Key:
    """The operator's: Enter."""

    def __init__(self) -> None:
        self._open = sys.stdin is not None and sys.stdin.isatty()

    def __call__(self) -> bool:
        """Whether it was pressed since this was last asked."""
        if not self._open or not select.select([sys.stdin], [], [], 0.0)[0]:
            return False
        self._open = bool(sys.stdin.readline())
        return self._open


@dataclasses.dataclass
class Learning:
    """A student and its learner, on the way to a robot."""

    arguments: Arguments
    policy: Policy
    course: Course
    learner: Remote
    odometer_name: str
    simulated: "Simulated | None"
    stop: Callable[[], bool]

    def student(self, clock: Clock) -> Student:
        """Who walks, and tells the learner.

        Raises:
            ValueError: the odometer's port cannot be opened.
        """
        odometer = Odometer(LinePort(self.odometer_name, "odometer"), clock)
        own = dataclasses.replace(self.policy, layers=self.learner.start)
        self._student = Student(own, self.learner, odometer, self.course.exploration)
        return self._student

    def lessons(
        self, poses: Poses, note: Callable[[log.Entry], None], react: Callable[[float, Sensed], None]
    ) -> Lessons:
        """Episodes of the student."""
        self.key = Key()
        return Lessons(
            poses,
            self._student,
            self.right,
            self.key,
            self.arguments.episode,
            self.arguments.torque,
            note,
            react,
            self._told,
        )

    def _told(self, episode: Episode) -> None:
        fell = ", and fell" if episode.fell else ""
        print(
            f"{episode.steps * 0.05:7.1f} s: {episode.metres:5.2f} m in {episode.seconds:.1f} s{fell}; "
            f"{self.learner.updates} updates.",
            flush=True,
        )

    def right(self) -> None:
        """A robot that has fallen is on its feet, or on its belly and somebody has pressed Enter.

        Raises:
            StoppedError: nobody did, and it was asked to stop.
        """
        if self.simulated:
            self.simulated.right()
            return
        print("It has fallen and has no torque. Lay it on its belly, and press Enter.", flush=True)
        while not self.key():
            if self.stop():
                raise StoppedError("it was asked to")
            time.sleep(0.05)


def go(arguments: Arguments, policy: Policy, ports: AbstractContextManager[tuple]) -> int:
    """Learns as the arguments say; exit code 1 where it ended before its time.

    Args:
        arguments: of the command line.
        policy: pi_B.
        ports: opens to the names of bus and inertial unit, and the simulated robot if it is one.

    Raises:
        ValueError: a port cannot be opened, nobody answers, or the directory is not what it should be.
    """
    folder = Path(arguments.resume or arguments.out)
    there = (folder / STATE).exists()
    if arguments.resume and not there:
        raise ValueError(f"resume is {folder}: there is no {STATE} in it; give the directory of a course.")
    if there and not arguments.resume:
        raise ValueError(f"out is {folder}, where something is learned already: give another, or --resume {folder}.")
    course = Course(policy, folder, arguments.algo or "srl", arguments.updates, arguments.seed, there)
    try:
        with Remote(course) as learner, ports as (bus, imu, simulated):
            if learner.steps:
                print(f"It goes on after {learner.steps} steps.", flush=True)
            stop = StopSignals().requested
            odometer = simulated.odometer if simulated else arguments.odometer
            learning = Learning(arguments, policy, course, learner, odometer, simulated, stop)
            own = {arguments.trained_for: policy}
            code = deploy_story.go(arguments, bus, imu, own, simulated, stop, learning)
    except KeyboardInterrupt:  # before anything moves: from then on it is a signal to lie down
        return 128 + 2
    print(f"What it has learned: {folder / STUDENT}, a policy to deploy; with --resume {folder} it goes on.")
    return code
