"""Who walks: an exported policy with its clock, shown what it was trained to see. By NumPy alone."""

from collections import deque

import numpy as np

from srl_jax.env.interface import ACTION_SIZE, CONTROL_HZ, layout, reading_size
from srl_jax.env.senses import Senses, observation, reading
from srl_jax.portable import Policy

KINDS = ("onboard", "rates")  # observations that a robot's sensors give


class Walker:
    """A policy on a robot, its gait's clock, and the steps behind it; the policy may be exchanged between two steps."""

    phase: float  # of the clock, in [0, 1)

    def __init__(self, policy: Policy) -> None:
        """A walker at the beginning of its stride.

        Raises:
            ValueError: the policy reads or does what this robot cannot tell or do, see `checked`.
        """
        self.policy = checked(policy)
        self.restart()

    def restart(self) -> None:
        """The beginning of a stride, with no step behind it."""
        self.phase = 0.0
        self._forget()

    def swap(self, policy: Policy) -> None:
        """From the next step on another policy walks, from where the clock stands; errors as `checked`.

        One that sees other steps behind it begins with none.
        """
        before, self.policy = self.policy, checked(policy)
        if _behind(before) != _behind(policy):
            self._forget()

    def see(self, senses: Senses) -> np.ndarray:
        """What the policy is shown, f32[O]."""
        about, phase = self.policy.about, np.float32(self.phase)
        behind = np.array(self._rows) if self._rows else None
        seen = observation(senses, phase, task=about["task"], kind=about["kind"], history=behind, xp=np)
        return np.asarray(seen, np.float32)

    def act(self, senses: Senses) -> tuple[np.ndarray, np.ndarray]:
        """What the policy sees f32[O], and its action f32[18] in [-1, 1]."""
        seen = self.see(senses)
        action = self.chosen(seen)
        self._row = np.concatenate([reading(senses, kind=self.policy.about["kind"], xp=np), action])
        return seen, action

    def chosen(self, seen: np.ndarray) -> np.ndarray:
        """The action f32[18] in [-1, 1] at an observation f32[O]."""
        return np.clip(self.policy(seen), -1.0, 1.0)

    def advance(self, steps: int = 1) -> None:
        """The clock goes on by control steps, in all of which the robot did what it does in this one."""
        if self._row is not None:
            self._rows.extend([self._row] * steps)
        self.phase = (self.phase + steps * float(self.policy.about["clock_hz"]) / CONTROL_HZ) % 1.0

    def offsets(self, action: np.ndarray) -> np.ndarray:
        """Radians f64[18] about the stance that an action asks for."""
        return np.asarray(self.policy.about["action_scale"], float) * np.asarray(action, float)

    def _forget(self) -> None:
        steps, row = _behind(self.policy)
        self._rows = deque([np.zeros(row, np.float32)] * steps, maxlen=steps)  # the newest last
        self._row: np.ndarray | None = None  # f32[R + 18] what is sensed and done in the present step


def checked(policy: Policy) -> Policy:
    """A policy that this robot can run.

    Raises:
        ValueError: it is for a task that needs to know the robot's place, reads what no sensor of it tells, or is of
            another robot.
    """
    about = policy.about
    task, kind, history = about.get("task"), about.get("kind"), about.get("history", 0)
    if kind not in KINDS:
        raise ValueError(
            f"policy reads the observation {kind!r}, of which a robot's sensors give {' and '.join(KINDS)} only: train "
            "with --env.observation onboard, or take one of the atlas."
        )
    if task != "x":
        raise ValueError(f"policy is for task {task!r}, for which a robot must know where it is: give one for x.")
    size = sum(size for _, size in layout(task, kind, history))
    if (policy.observation_size, policy.action_size) != (size, ACTION_SIZE):
        raise ValueError(
            f"policy reads {policy.observation_size} numbers and gives {policy.action_size}: this robot has {size} of "
            f"{kind} for {task}, and {ACTION_SIZE} joints."
        )
    if about.get("control_hz") != CONTROL_HZ:
        raise ValueError(f"policy acts at {about.get('control_hz')} Hz: this robot's loop has {CONTROL_HZ}.")
    return policy


def _behind(policy: Policy) -> tuple[int, int]:
    """How many control steps before the present one a policy sees, and numbers of each."""
    return policy.about.get("history", 0), reading_size(policy.about["kind"]) + ACTION_SIZE
