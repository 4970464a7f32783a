"""A walker that explores, and tells whoever learns what came of it. By NumPy alone."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from srl_jax.env.interface import ACTION_SIZE
from srl_jax.env.senses import Senses
from srl_jax.portable import Layer, Policy
from srl_jax.robot.odometer import Odometer
from srl_jax.robot.policy import Walker


class Step(NamedTuple):
    """A transition between two control steps."""

    observation: np.ndarray  # f32[O]
    action: np.ndarray  # f32[18], as it was sent
    progress: float  # m
    fell: bool
    next_observation: np.ndarray  # f32[O]


class Episode(NamedTuple):
    """What became of an episode."""

    steps: int  # of control, until its end, since learning began
    seconds: float
    metres: float  # in the direction that it began in
    fell: bool


class Learner(Protocol):
    """Who learns, here or in another process."""

    steps: int  # that it had been given before

    def take(self, step: Step) -> Sequence[Layer] | None:
        """Learns from a step; the weights of a student that has learned since, if there is one.

        Raises:
            StoppedError: it has gone.
        """
        ...

    def ended(self, episode: Episode) -> None:
        """An episode is over."""
        ...


@dataclasses.dataclass(frozen=True)
class Exploration:
    """Noise on actions, as `agents.noise` has it."""

    size: float = 0.1  # standard deviation; 0: none
    correlation: float = 0.85  # from step to step
    seed: int = 0


class Student(Walker):
    """Its policy is exchanged between two steps for what has been learned."""

    def __init__(self, policy: Policy, learner: Learner, odometer: Odometer, exploration: Exploration) -> None:
        """A student before its first episode.

        Raises:
            ValueError: as `policy.checked`.
        """
        super().__init__(policy)
        self.learner, self.odometer, self.exploration = learner, odometer, exploration
        self.come = 0.0  # m in this episode
        self._last: tuple[np.ndarray, np.ndarray, float] | None = None
        self.begin(0)

    def begin(self, number: int) -> None:
        """An episode begins, whose noise is that of its number."""
        self.restart()
        self.come, self._last = 0.0, None
        self.odometer.begin()
        self._random = np.random.default_rng((self.exploration.seed, number))
        self._noise = self._random.standard_normal(ACTION_SIZE)

    def act(self, senses: Senses) -> tuple[np.ndarray, np.ndarray]:
        """What it sees f32[O], and its action f32[18] with noise, in [-1, 1]; before it learns from the last step.

        Raises:
            StoppedError: the learner has gone.
        """
        seen, action = super().act(senses)
        self._last = seen, action, self.come
        return seen, action

    def chosen(self, seen: np.ndarray) -> np.ndarray:
        """As `Walker.chosen`, with noise; learns from the last step before, which is complete now."""
        self._told(seen, fell=False)
        rho = self.exploration.correlation
        self._noise = rho * self._noise + math.sqrt(1.0 - rho**2) * self._random.standard_normal(ACTION_SIZE)
        return np.clip(self.policy(seen) + self.exploration.size * self._noise, -1.0, 1.0).astype(np.float32)

    def advance(self, steps: int = 1) -> None:
        """The clock goes on; nothing is learned from what took more than one control step."""
        super().advance(steps)
        if steps > 1:
            self._last = None

    def fell(self) -> None:
        """The last step has ended in a fall: what comes after it is worth nothing."""
        if self._last is not None:
            self._told(self._last[0], fell=True)

    def _told(self, seen: np.ndarray, fell: bool) -> None:
        come = self.odometer.come()
        if math.isnan(come):
            self._last = None
            return
        last, self._last, self.come = self._last, None, come
        if last is None:
            return
        learned = self.learner.take(Step(last[0], last[1], come - last[2], fell, seen))
        if learned is not None:
            self.swap(dataclasses.replace(self.policy, layers=tuple(learned)))
