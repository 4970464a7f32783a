"""Learning on the robot, in lock-step with its simulation: metres of an episode before and after.

    python -m experiments.robot_learning --minutes 10 --figure robot_learning.png

The healthy policy walks, the damage strikes in mid-walk, and it learns on, by the code of ``deploy --learn``.
"""

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from srl_jax import pretrained
from srl_jax.env.damage_names import HEALTHY
from srl_jax.job.course import Course
from srl_jax.job.learner import Learner
from srl_jax.portable import Policy
from srl_jax.robot import bus, imu, safety, servo
from srl_jax.robot.hexapod import Hexapod
from srl_jax.robot.lessons import Lessons
from srl_jax.robot.odometer import Odometer
from srl_jax.robot.simulate.body import Body
from srl_jax.robot.simulate.line import Faults
from srl_jax.robot.simulate.wire import Lockstep, Overhead, Wire
from srl_jax.robot.student import Episode, Exploration, Step, Student


@dataclass(frozen=True)
class Args:
    """Measure what a robot learns."""

    damage: str = "leg_rm"
    """That strikes."""
    algo: str = "srl"
    """srl or ddpg_warm."""
    minutes: float = 10.0
    """Of walking while it learns."""
    updates: int = 2
    """A control step."""
    episodes: int = 10
    """Without noise, before and after."""
    seed: int = 0
    """Of noise, batches and networks."""
    figure: str = ""
    """A PNG of metres by minute; empty: none."""
    keep: str = ""
    """A directory for what is learned; empty: none is kept."""


class Still:
    """Who is told of a walk and learns nothing."""

    def __init__(self) -> None:
        self.steps = 0
        self.episodes: list[Episode] = []

    def take(self, step: Step) -> None:
        """Learns nothing."""

    def ended(self, episode: Episode) -> None:
        """Remembers an episode."""
        self.episodes.append(episode)


class Outdoors:
    """A robot in lock-step that stands, healthy until it is struck."""

    def __init__(self, args: Args) -> None:
        self.body = Body(HEALTHY, seed=args.seed, noise=1.0)
        self.body.prepare(args.damage)
        self.clock = Lockstep(self.body)
        calibration = servo.Calibration()
        wire = Wire(self.clock, Faults(), seed=args.seed)
        own = bus.Bus(wire, calibration.ranges())
        self.robot = Hexapod(own, imu.Imu(self.clock, self.clock), calibration, servo.Servos())
        self.odometer = Odometer(Overhead(self.clock), self.clock)
        self.poses = safety.Poses(self.robot, self.clock, safety.Watch(), lambda: False)
        self.poses.rise()

    def lessons(self, student: Student) -> Lessons:
        """Episodes of a student; whoever falls is put right."""
        return Lessons(self.poses, student, self.body.right)

    def measure(self, policy: Policy, episodes: int, seed: int) -> list[Episode]:
        """Episodes of 5 s without noise."""
        still = Still()
        self.lessons(Student(policy, still, self.odometer, Exploration(0.0, seed=seed))).run(5.0 * episodes)
        return still.episodes


def told(name: str, episodes: list[Episode]) -> None:
    """Prints a row."""
    metres = np.array([each.metres for each in episodes])
    falls = sum(each.fell for each in episodes)
    print(f"{name:<28}{metres.mean():>7.2f} m ({metres.min():.2f} to {metres.max():.2f}), {falls} falls", flush=True)


def struck(outdoors: Outdoors, args: Args, policy: Policy) -> None:
    """Walks healthy, and loses the damage in mid-walk."""
    told("healthy", outdoors.measure(policy, args.episodes, args.seed))
    left = [2.5]

    def react(now: float, _: object) -> None:
        if left and now >= left[0]:
            left.clear()
            outdoors.body.strike(args.damage)

    walk = outdoors.lessons(Student(policy, Still(), outdoors.odometer, Exploration(0.0)))
    walk.react = react
    walk.run(5.0)
    names = ", ".join(joint for _, joint in walk.outcome.died)
    print(f"{args.damage} strikes after 2.5 s of a walk; joints lost: {names or 'none'}", flush=True)


def draw(path: str, curves: dict[str, list[Episode]], levels: dict[str, float]) -> None:
    """Metres of an episode by the minute."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5.2, 3.0), dpi=110)
    for name, episodes in curves.items():
        minutes, metres = [x.steps / 1200 for x in episodes], np.array([x.metres for x in episodes])
        (shown,) = axes.plot(minutes, metres, ".", markersize=4, alpha=0.5, label=name)
        width = min(9, len(metres))
        mean = np.convolve(metres, np.ones(width) / width, "valid")
        axes.plot(minutes[width // 2 : width // 2 + len(mean)], mean, color=shown.get_color())
    for (name, level), style in zip(levels.items(), ("--", ":"), strict=False):
        axes.axhline(level, color="0.4", linestyle=style, linewidth=1, label=name)
    axes.set(xlabel="minutes of walking", ylabel="metres in 5 s")
    axes.legend(frameon=False, fontsize=7)
    figure.tight_layout()
    figure.savefig(path)
    pyplot.close(figure)


def main(args: Args) -> None:
    """Prints rows, and draws the curve."""
    policy = pretrained.load("atlas", task="x", damage=HEALTHY)
    outdoors, began = Outdoors(args), time.monotonic()
    struck(outdoors, args, policy)
    before = outdoors.measure(policy, args.episodes, args.seed)
    told("before", before)
    known = outdoors.measure(pretrained.load("atlas", task="x", damage=args.damage), args.episodes, args.seed)
    told("the atlas' own policy", known)
    with tempfile.TemporaryDirectory() as folder:
        course = Course(policy, Path(args.keep or folder), args.algo, args.updates, args.seed)
        learner = Learner(course)
        lessons = outdoors.lessons(Student(policy, learner, outdoors.odometer, course.exploration))
        lessons.told = lambda x: print(f"{x.steps:>6} steps {x.metres:6.2f} m{' fell' * x.fell}", flush=True)
        lessons.run(60.0 * args.minutes)
        learner.save()
    learned = replace(policy, layers=learner.layers)
    after = outdoors.measure(learned, args.episodes, args.seed)
    told(f"after {args.minutes:g} min, {args.algo}", after)
    print(f"{learner.steps} steps learned from, {learner.updates} updates, {time.monotonic() - began:.0f} s")
    if args.figure:
        levels = {"before": float(np.mean([x.metres for x in before]))}
        levels["the atlas' policy for it"] = float(np.mean([x.metres for x in known]))
        draw(args.figure, {args.algo: learner.episodes}, levels)


if __name__ == "__main__":
    main(tyro.cli(Args))
