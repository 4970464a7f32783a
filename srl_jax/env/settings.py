"""The settings of the task around the robot. Imports no jax, so that ``--help`` answers at once."""

from dataclasses import dataclass
from typing import Literal, get_args, get_type_hints

TASKS = ("x", "xy", "p2p")


@dataclass(frozen=True)
class EnvConfig:
    """The task around the robot. Lengths in metres, times in control steps of 1/20 s."""

    episode_steps: int = 100
    """Control steps until an episode is truncated."""
    physics: Literal["auto", "star", "mjx"] = "auto"
    """What steps the robots (--physics will do): mjx, or star, which does the same for robots of this shape, ten times
    as fast on a CPU. auto: star on a CPU, on an accelerator the faster of both, which is measured."""
    reward: Literal["dense", "sparse"] = "dense"
    """dense: progress, effort, goal and fall terms; sparse: 1 on reaching the goal, else 0."""
    observation: Literal["full", "onboard", "rates"] = "full"
    """onboard: only what the real robot senses (joint angles, clock, gravity, goal direction); rates: with what its
    gyroscope and servos say of speeds; full: base velocity and height too, which no sensor of its has."""
    history: int = 0
    """Control steps that the observation also tells of: what was sensed and done in them, oldest first; zeros before
    the robot was there."""
    randomise: Literal["none", "mild", "wide"] = "none"
    """How much robots differ from the model, drawn anew at every reset: masses, floor, servos, latency, sensors, lost
    packets, pushes, slope."""
    goal_ring: tuple[float, float] = (1.5, 1.9)
    """p2p: the goal is drawn uniformly in angle and radius from this ring about the start."""
    goal_radius: float = 0.15
    """p2p: distance to the goal that counts as reached."""
    sparse_distance: float = 1.0
    """x and xy under the sparse reward: the displacement that counts as the goal."""
    start_noise: float = 0.05
    """Half-width of the uniform noise on the joint angles at reset, rad."""
    stride_starts: float = 0.0
    """Share of episodes that start in mid-stride: from a robot whose damage struck while it walked, a second ago at
    most."""
    progress_weight: float = 50.0
    """Reward per metre of progress (20 Hz: 0.4 m/s earns 1 a step)."""
    effort_weight: float = 0.05
    """Reward lost per unit of mean squared action."""
    goal_bonus: float = 5.0
    """Reward for reaching the goal of p2p."""
    fall_penalty: float = 1.0
    """Reward lost on tipping over, which ends the episode."""

    def check(self) -> None:
        """Raises ValueError for words that name nothing and numbers that make no task."""
        for name, kind in get_type_hints(EnvConfig).items():
            if (words := get_args(kind)) and isinstance(words[0], str) and getattr(self, name) not in words:
                raise ValueError(f"env.{name} is {getattr(self, name)!r}: choose one of {', '.join(words)}.")
        if self.episode_steps < 1:
            raise ValueError(f"env.episode_steps is {self.episode_steps}: it must be at least 1.")
        if self.history < 0:
            raise ValueError(f"env.history is {self.history}: it must not be negative.")
        if not 0.0 <= self.stride_starts <= 1.0:
            raise ValueError(f"env.stride_starts is {self.stride_starts}: it must lie between 0 and 1.")
        low, high = self.goal_ring
        if not self.goal_radius < low <= high:
            raise ValueError(
                f"env.goal_ring is {self.goal_ring}: it must rise and lie beyond env.goal_radius={self.goal_radius}."
            )
