"""The loop of 20 Hz: read, think, and send at the deadline.

Goals go out at the deadline itself, so that their jitter is that of one packet. Servos are read in a window before it,
as long as a round has lately taken, so that what the policy sees is as new as it can be; angles are foretold for the
deadline by the servos' own speeds.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from srl_jax.robot import log
from srl_jax.robot.clock import Clock
from srl_jax.robot.hexapod import PERIOD, Hexapod, Sensed
from srl_jax.robot.policy import Walker
from srl_jax.robot.safety import Watch
from srl_jax.robot.servo import STANDING

THINK = 0.003  # s before the deadline at which reading ends
WIDEST = 0.9 * PERIOD  # of the window


@dataclass
class Outcome:
    """What became of a walk."""

    late: list[float] = field(default_factory=list)  # s after the deadline, a step each
    overruns: int = 0  # steps whose work was not done at their deadline
    skipped: int = 0  # deadlines that were passed over
    missed: int = 0  # readings that did not come and were foretold
    died: list[tuple[float, str]] = field(default_factory=list)  # s since the start, joint
    seconds: float = 0.0
    stopped: bool = False  # by somebody, before its time

    def jitter(self, share: float) -> float:
        """s of lateness that this share of the steps kept within."""
        return float(np.quantile(self.late, share)) if self.late else float("nan")


@dataclass
class Loop:
    """A walker on a robot."""

    robot: Hexapod
    walker: Walker
    clock: Clock
    watch: Watch
    stop: Callable[[], bool]  # whether somebody wants it to stop
    note: Callable[[log.Entry], None] = lambda _: None
    react: Callable[[float, Sensed], None] = lambda *_: None  # s since the start; may exchange the walker's policy
    outcome: Outcome = field(default_factory=Outcome)

    def run(self, seconds: float) -> Outcome:
        """Walks for so long, or until somebody wants it to stop.

        Raises:
            StoppedError: as `Watch.check`; the outcome so far is `outcome`.
            BusLostError: the bus has gone.
        """
        outcome, took = self.outcome, deque([WIDEST], maxlen=10)
        start = deadline = self.clock.now()
        while deadline + PERIOD <= start + seconds + 1e-9:
            deadline += PERIOD
            self.clock.sleep_until(deadline - min(max(took) + THINK, WIDEST))
            began = self.clock.now()
            sensed = self.robot.sense(deadline - THINK, deadline)
            took.append(WIDEST if sensed.missed else self.clock.now() - began)  # bad packets want time
            self.watch.check(sensed)
            outcome.missed += sensed.missed
            outcome.died += [(deadline - start, joint) for joint in sensed.died]
            self.react(deadline - start, sensed)
            phase = self.walker.phase
            _, action = self.walker.act(sensed.senses)
            goals = self.robot.command(STANDING + self.walker.offsets(action), sensed)
            if self.stop():
                outcome.stopped = True
                break
            outcome.overruns += self.clock.now() > deadline
            self.clock.sleep_until(deadline)
            late = self.clock.now() - deadline
            self.robot.send(goals)
            outcome.late.append(late)
            outcome.seconds = deadline + late - start
            self.note(log.entry(deadline + late - start, late, phase, sensed, action, goals))
            passed = int(late / PERIOD)  # deadlines that are no longer to be kept
            outcome.skipped += passed
            deadline += passed * PERIOD
            self.walker.advance(1 + passed)
        return outcome
