"""The robot as a Gymnasium environment in C MuJoCo, registered when this module is imported.

``gymnasium.make("srl_jax.standard.gym:srl_jax/Hexapod-v0", task="x", damage="leg_rm")`` imports it by itself. One
process, one robot, a call a step, for libraries that want it so; the training program steps thousands at once.
"""

from collections.abc import Iterator
from typing import Any, get_args

import gymnasium
import numpy as np

from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.env.hexapod import ACTION_SIZE, CONTROL_HZ, observation_size
from srl_jax.report.paint import SIZE, Painter, paint, visible_model
from srl_jax.report.video import GOAL
from srl_jax.standard.numpy_robot import Physics, Robot
from srl_jax.standard.settings import Settings, configured

NAME = "srl_jax/Hexapod-v0"
MODES = (None, "rgb_array")


class Hexapod(gymnasium.Env[np.ndarray, np.ndarray]):
    """A damaged robot and its task: observations f32[O], see `env.interface.layout`; actions f32[18] in [-1, 1]."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": int(CONTROL_HZ)}  # noqa: RUF012  Gymnasium's own type

    def __init__(
        self,
        task: str = "p2p",
        damage: str = "healthy",
        physics: Physics = "training",
        *,
        settings: Settings = None,
        clock_hz: float | None = None,
        render_mode: str | None = None,
        painter: Painter = "auto",
        size: tuple[int, int] = SIZE,
    ):
        """A robot that `reset` puts on its feet.

        Args:
            task: x, xy or p2p.
            damage: names and sets as of ``srl-jax run --damage``, such as ``leg_rm`` or ``losses21,healthy``; each
                episode draws one of them.
            physics: training, the coarse steps that the training program makes, or converged, 2 ms and 50 iterations,
                which leave no error worth naming.
            settings: fields of `EnvConfig` that shall be others, such as ``{"observation": "onboard"}``, or a whole
                one; its `physics` is not read.
            clock_hz: of the gait's clock in the observation; None: the scripted gait's.
            render_mode: None, or rgb_array for pictures u8[height, width, 3] of `render`.
            painter: gl, plain, or auto for gl where it works.
            size: width and height of a picture, pixels, both even.

        Raises:
            ValueError: something is none of these.
        """
        config = configured(task, settings)
        if physics not in get_args(Physics):
            raise ValueError(f"physics is {physics!r}: choose one of {', '.join(get_args(Physics))}.")
        if render_mode not in MODES:
            raise ValueError(f"render_mode is {render_mode!r}: choose one of {', '.join(map(repr, MODES))}.")
        self.damages = damage_names.parse_names(damage, task)
        hertz = float(gaits.load().frequency) if clock_hz is None else clock_hz
        self.robot = Robot(task, config, self.damages[0], hertz, physics)
        self.render_mode, self._size = render_mode, size
        self._painter: Painter = painter
        self._pictures: Iterator[np.ndarray] | None = None
        numbers = observation_size(task, config)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (numbers,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Starts an episode.

        Args:
            seed: of the starts, goals and damages from here on.
            options: ``{"damage": name}`` for the damage of this episode.

        Returns:
            The observation f32[O], and the damage's name.

        Raises:
            ValueError: an unknown option, or a bad damage name.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        damage = options.pop("damage", None)
        if options:
            raise ValueError(f"options has {next(iter(options))!r}: only damage is accepted.")
        if damage is None:
            several = len(self.damages) > 1
            damage = self.damages[self.np_random.integers(len(self.damages)) if several else 0]
        self.strike(damage)
        return self.robot.reset(self.np_random), {"damage": self.robot.damage}

    def strike(self, damage: str) -> None:
        """Damages the robot in mid-stride; it stays damaged until the next `reset`.

        Raises:
            ValueError: for a bad damage name.
        """
        self.robot.strike(damage_names.canonical(damage))
        self.close()  # what is drawn has changed

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control step of 1/20 s; an action outside its bounds counts as the nearest inside.

        Returns:
            Observation f32[O], reward, terminated (goal reached or tipped over), truncated (out of time), and the
            success, fall, progress (m) and terms of the reward (``reward/effort`` and so on).

        Raises:
            ValueError: the action has another shape.
        """
        action = np.asarray(action)
        if action.shape != (ACTION_SIZE,):
            raise ValueError(f"action has the shape {action.shape}: ({ACTION_SIZE},) is accepted.")
        out = self.robot.step(np.clip(action, -1.0, 1.0))
        terms = {f"reward/{name}": value for name, value in out.terms.items()}
        about = {"success": out.success, "fell": out.fell, "progress": out.progress, **terms}
        return out.observation, out.reward, out.terminated, out.truncated, about

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The present pose, u8[height, width, 3]; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._pictures is None:
            self._pictures = self._drawn()
        return next(self._pictures)

    def close(self) -> None:
        """Gives the renderer back."""
        self._pictures = None

    def _drawn(self) -> Iterator[np.ndarray]:
        """The robot as it stands whenever one asks; one renderer serves an episode."""
        robot = self.robot
        marker = (robot.goal, robot.config.goal_radius, GOAL) if robot.task == "p2p" else None
        yield from paint(visible_model(robot.damage), self._poses(), marker, painter=self._painter, size=self._size)

    def _poses(self) -> Iterator[np.ndarray]:
        while True:
            yield self.robot.data.qpos.copy()


gymnasium.register(id=NAME, entry_point=f"{__name__}:Hexapod")
