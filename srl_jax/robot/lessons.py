"""Episodes, one after the other: a walk of so many seconds or until it falls, then the stance again."""

from collections.abc import Callable
from dataclasses import dataclass, field

from srl_jax.robot import log
from srl_jax.robot.hexapod import PERIOD, Sensed
from srl_jax.robot.loop import Loop, Outcome
from srl_jax.robot.safety import Poses, TippedError, Watch
from srl_jax.robot.student import Episode, Student


@dataclass
class Lessons:
    """A student on a robot that stands."""

    poses: Poses
    student: Student
    right: Callable[[], None]  # somebody lays a robot that has fallen on its belly; returns when that is done
    over: Callable[[], bool] = lambda: False  # whether somebody wants this episode to end
    episode: float = 5.0  # s
    torque: float = 1.0  # as in `Poses.rise`
    note: Callable[[log.Entry], None] = lambda _: None
    react: Callable[[float, Sensed], None] = lambda *_: None  # s of walking so far
    told: Callable[[Episode], None] = lambda _: None
    outcome: Outcome = field(default_factory=Outcome)  # of all episodes
    number: int = 0  # of episodes

    def run(self, seconds: float) -> Outcome:
        """Episodes until the student has walked for so long in all, what it had learned from before counted in.

        Raises:
            StoppedError: as `Watch.check` but for falls, after which it is put right; or the learner has gone.
            BusLostError: the bus has gone.
        """
        total = round(seconds / PERIOD)
        steps = begun = self.student.learner.steps
        while steps < total and not self.poses.stop():
            # One step more than is learned from: a step is complete when the next has begun.
            walked, fell = self._walk(min(round(self.episode / PERIOD), total - steps) + 1, steps - begun, begun)
            steps += walked
            ended = Episode(steps, walked * PERIOD, self.student.come, fell)
            self.number += 1
            self.student.learner.ended(ended)
            self.told(ended)
            if fell:
                self._up()
            elif not self.poses.stop():
                self.poses.stand()
        return self.outcome

    def _walk(self, most: int, before: int, begun: int) -> tuple[int, bool]:
        """One episode: its control steps, and whether it fell."""
        poses, student, fell = self.poses, self.student, False
        student.begin(begun + before)
        if poses.robot.imu is not None:
            poses.robot.imu.heading = 0.0  # ahead is where it looks now
        react = lambda now, sensed: self.react(before * PERIOD + now, sensed)  # noqa: E731
        stop = lambda: poses.stop() or self.over()  # noqa: E731
        own = Outcome()
        loop = Loop(poses.robot, student, poses.clock, poses.watch, stop, self.note, react, own)
        try:
            loop.run(most * PERIOD)
        except TippedError:
            fell = True
            student.fell()
        finally:
            _add(self.outcome, own, before * PERIOD)
        return max(len(own.late) - (not fell), 1), fell

    def _up(self) -> None:
        poses = self.poses
        poses.robot.bus.limp()
        self.right()
        poses.watch = Watch(poses.watch.limits)
        poses.rise(self.torque)


def _add(outcome: Outcome, other: Outcome, before: float) -> None:
    outcome.late += other.late
    outcome.overruns += other.overruns
    outcome.skipped += other.skipped
    outcome.missed += other.missed
    outcome.died += [(before + when, joint) for when, joint in other.died]
    outcome.seconds += other.seconds
    outcome.stopped = other.stopped
