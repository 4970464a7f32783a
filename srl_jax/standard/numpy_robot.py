"""The robot and its tasks in C MuJoCo and plain NumPy, as a Gymnasium environment is mostly written.

The same task as `srl_jax.env.hexapod`, one robot, a call a step; tests hold them against each other.
"""

from functools import lru_cache
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, UPRIGHT
from srl_jax.env.history import row_size
from srl_jax.env.model import stance
from srl_jax.env.settings import EnvConfig
from srl_jax.env.task import CLIP, ends_on_success
from srl_jax.evaluate import converged_model

Physics = Literal["training", "converged"]
MODELS = {"training": damages.damaged_model, "converged": converged_model}


class Outcome(NamedTuple):
    """What one control step returns, of plain numbers; the names of `hexapod.EnvStep`."""

    observation: np.ndarray  # f32[O]
    reward: float
    terminated: bool  # goal reached or tipped over
    truncated: bool  # out of time, and not terminated
    success: bool
    fell: bool
    progress: float  # m come closer in this step
    terms: dict[str, float]  # the reward is their sum


@lru_cache(maxsize=256)
def _model(damage: str, physics: Physics) -> mujoco.MjModel:
    """Shared by all robots of one process, none of which changes it."""
    return MODELS[physics](damage)


class Robot:
    """One robot with its task: `reset`, `step`, and `strike` for damage in mid-stride."""

    def __init__(self, task: str, config: EnvConfig, damage: str, clock_hz: float, physics: Physics = "training"):
        """Arguments as of `hexapod.make`.

        Args:
            task: x, xy or p2p.
            config: the task's settings; `physics` and `stride_starts` are not read.
            damage: a name of `damage_names`.
            clock_hz: of the observed gait clock.
            physics: training, as the training program steps it, or converged, as finely as leaves no error worth
                naming.

        Raises:
            ValueError: for a bad damage name.
        """
        self.task, self.config, self.physics = task, config, physics
        self.strike(damage)
        self.data = mujoco.MjData(self.model)
        self.stance, self.scale = stance(self.model), np.tile(ACTION_SCALE, 6)
        self.tick, self.substeps = clock_hz / CONTROL_HZ, round(1.0 / (CONTROL_HZ * self.model.opt.timestep))
        self.ends = ends_on_success(task, config)
        self.goal, self.phase, self.steps = np.zeros(2), 0.0, 0
        self._frame = np.zeros(9)
        self._history = np.zeros((config.history, row_size(config.observation)), np.float32)

    def strike(self, damage: str) -> None:
        """Damages the robot where it stands; its motion goes on.

        Raises:
            ValueError: for a bad damage name.
        """
        self.model, self.damage = _model(damage, self.physics), damage
        self.free = self.model.dof_armature[6:] < damages.LOCK_ARMATURE
        self.felt = (self.model.body_mass[2:] > damages.PRESENT).astype(float)

    def reset(self, random: np.random.Generator) -> np.ndarray:
        """Starts an episode; its first observation f32[O]."""
        mujoco.mj_resetData(self.model, self.data)
        noise = self.config.start_noise * random.uniform(-1.0, 1.0, len(self.free))
        joints = np.where(self.free, self.stance[7:] + noise, self.model.qpos_spring[7:])  # where a locked one locked
        self.data.qpos[:] = *self.stance[:7], *joints
        self.phase, self.steps = random.uniform(), 0
        if self.task == "p2p":
            radius, angle = random.uniform(*self.config.goal_ring), random.uniform(-np.pi, np.pi)
            self.goal = radius * np.array([np.cos(angle), np.sin(angle)])
        self._history[:] = 0.0
        return self.observe()

    def step(self, action: np.ndarray) -> Outcome:
        """One control step of 1/20 s under an action f[18] in [-1, 1]."""
        config, before = self.config, self.distance()
        if config.history:
            self._history[:-1] = self._history[1:]
            self._history[-1] = np.concatenate([*self._reading(), action])
        self.data.ctrl[:] = self.stance[7:] + self.scale * action
        mujoco.mj_step(self.model, self.data, self.substeps)
        self.phase, self.steps = (self.phase + self.tick) % 1.0, self.steps + 1
        come = self.distance()
        success = bool(come > -config.goal_radius if self.task == "p2p" else come >= config.sparse_distance)
        observation = self.observe()
        fell = bool(self._frame[8] < UPRIGHT)
        terminated = (success and self.ends) or fell
        terms = self._terms(come - before, action, success, fell)
        truncated = self.steps >= config.episode_steps and not terminated
        return Outcome(observation, sum(terms.values()), terminated, truncated, success, fell, come - before, terms)

    def _terms(self, progress: float, action: np.ndarray, success: bool, fell: bool) -> dict[str, float]:
        """The parts of the reward, as `task.reward_terms`."""
        config = self.config
        if config.reward == "sparse":
            return {"progress": 0.0, "effort": 0.0, "goal": float(success), "fall": 0.0}
        return {
            "progress": min(max(config.progress_weight * progress, -CLIP), CLIP),
            "effort": -config.effort_weight * float(action @ action) / len(action),
            "goal": config.goal_bonus * (success and self.ends),
            "fall": -config.fall_penalty * fell,
        }

    def distance(self) -> float:
        """How far the robot has come, m, up to a constant of the episode."""
        x, y = self.data.qpos[:2]
        if self.task == "x":
            return float(x)
        return float(np.hypot(x, y)) if self.task == "xy" else -float(np.hypot(self.goal[0] - x, self.goal[1] - y))

    def observe(self) -> np.ndarray:
        """The observation f32[O] of the present state; leaves the rotation, body to world, in `_frame`."""
        readings, frame = self._reading(), self._frame
        x, y = self.data.qpos[:2]
        if self.task == "x":
            east, north = 1.0, 0.0
        else:
            east, north = (x + 0.1, y) if self.task == "xy" else (self.goal[0] - x, self.goal[1] - y)
            length = max(float(np.hypot(east, north)), 1e-6)
            east, north = east / length, north / length
        level = max(float(np.hypot(frame[0], frame[3])), 1e-6)
        heading_x, heading_y = frame[0] / level, frame[3] / level
        angle = 2.0 * np.pi * self.phase
        head: list[Any] = [np.sin(angle), np.cos(angle)]
        head += [east * heading_x + north * heading_y, heading_x * north - heading_y * east]
        if self.task == "p2p":
            head.append(min(-self.distance(), 2.0))
        return np.concatenate([head, *readings, self._history.ravel()], dtype=np.float32)

    def _reading(self) -> list[np.ndarray]:
        """What of the observation is sensed of the body, see `senses.reading`."""
        qpos, qvel, kind = self.data.qpos, self.data.qvel, self.config.observation
        mujoco.mju_quat2Mat(self._frame, qpos[3:7])
        parts = [-self._frame[6:9], self.felt * (qpos[7:] - self.stance[7:])]
        if kind == "full":
            parts.append(qvel[:3] @ self._frame.reshape(3, 3))
        if kind != "onboard":
            parts += [0.3 * qvel[3:6], 0.1 * self.felt * qvel[6:]]
        if kind == "full":
            parts.append(10.0 * qpos[2:3])
        return parts
