"""Who walks: an exported policy with its clock, shown what it was trained to see. By NumPy alone."""

import numpy as np

from srl_jax.env.interface import ACTION_SIZE, CONTROL_HZ, layout
from srl_jax.env.senses import Senses, observation
from srl_jax.portable import Policy

KINDS = ("onboard", "rates")  # observations that a robot's sensors give


class Walker:
    """A policy on a robot, and its gait's clock; the policy may be exchanged between two steps."""

    def __init__(self, policy: Policy) -> None:
        """A walker at the beginning of its stride.

        Raises:
            ValueError: the policy reads or does what this robot cannot tell or do, see `checked`.
        """
        self.policy = checked(policy)
        self.phase = 0.0  # of the clock, in [0, 1)

    def swap(self, policy: Policy) -> None:
        """From the next step on another policy walks, from where the clock stands; errors as `checked`."""
        self.policy = checked(policy)

    def see(self, senses: Senses) -> np.ndarray:
        """What the policy is shown, f32[O]."""
        about = self.policy.about
        phase = np.float32(self.phase)
        return np.asarray(observation(senses, phase, task=about["task"], kind=about["kind"], xp=np), np.float32)

    def act(self, senses: Senses) -> tuple[np.ndarray, np.ndarray]:
        """What the policy sees f32[O], and its action f32[18] in [-1, 1]."""
        seen = self.see(senses)
        return seen, np.clip(self.policy(seen), -1.0, 1.0)

    def advance(self, steps: int = 1) -> None:
        """The clock goes on by control steps."""
        self.phase = (self.phase + steps * float(self.policy.about["clock_hz"]) / CONTROL_HZ) % 1.0

    def offsets(self, action: np.ndarray) -> np.ndarray:
        """Radians f64[18] about the stance that an action asks for."""
        return np.asarray(self.policy.about["action_scale"], float) * np.asarray(action, float)


def checked(policy: Policy) -> Policy:
    """A policy that this robot can run.

    Raises:
        ValueError: it is for a task that needs to know the robot's place, reads what no sensor of it tells, tells of
            steps before, or is of another robot.
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
    if history:
        raise ValueError(f"policy reads {history} control steps before: give one of --env.history 0.")
    size = sum(size for _, size in layout(task, kind))
    if (policy.observation_size, policy.action_size) != (size, ACTION_SIZE):
        raise ValueError(
            f"policy reads {policy.observation_size} numbers and gives {policy.action_size}: this robot has {size} of "
            f"{kind} for {task}, and {ACTION_SIZE} joints."
        )
    if about.get("control_hz") != CONTROL_HZ:
        raise ValueError(f"policy acts at {about.get('control_hz')} Hz: this robot's loop has {CONTROL_HZ}.")
    return policy
