"""The robot and its tasks in C MuJoCo and plain NumPy, as a Gymnasium environment is mostly written.

The same task as `srl_jax.env.hexapod`, one robot, a call a step; tests hold them against each other.
"""

from typing import Any

import mujoco
import numpy as np

from srl_jax.env.settings import EnvConfig

CLIP = 2.0  # of the reward's progress, as in `srl_jax.env.task`


class Robot:
    """One damaged robot with its task: `reset` and `step`."""

    def __init__(self, task: str, config: EnvConfig, damage: str, clock_hz: float):
        from srl_jax.env import damage as damages
        from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, SUBSTEPS, UPRIGHT
        from srl_jax.env.model import stance

        self.task, self.config = task, config
        self.model = damages.damaged_model(damage)
        self.data = mujoco.MjData(self.model)
        self.stance, self.scale = stance(self.model), np.tile(ACTION_SCALE, 6)
        self.free = self.model.dof_armature[6:] < damages.LOCK_ARMATURE
        self.felt = (self.model.body_mass[2:] > damages.PRESENT).astype(float)
        self.tick, self.substeps, self.upright = clock_hz / CONTROL_HZ, SUBSTEPS, UPRIGHT
        self.ends = task == "p2p" or config.reward == "sparse"
        self.goal, self.phase, self.steps = np.zeros(2), 0.0, 0
        self._frame = np.zeros(9)

    def reset(self, random: np.random.Generator) -> np.ndarray:
        """Starts an episode; its first observation f32[O]."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.stance
        noise = self.config.start_noise * random.uniform(-1.0, 1.0, len(self.free))
        self.data.qpos[7:] += np.where(self.free, noise, 0.0)
        self.phase, self.steps = random.uniform(), 0
        if self.task == "p2p":
            radius, angle = random.uniform(*self.config.goal_ring), random.uniform(-np.pi, np.pi)
            self.goal = radius * np.array([np.cos(angle), np.sin(angle)])
        return self.observe()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool]:
        """One control step: observation f32[O], reward, whether it terminated, whether it is out of time."""
        config, before = self.config, self.distance()
        self.data.ctrl[:] = self.stance[7:] + self.scale * action
        mujoco.mj_step(self.model, self.data, self.substeps)
        self.phase, self.steps = (self.phase + self.tick) % 1.0, self.steps + 1
        come = self.distance()
        success = come > -config.goal_radius if self.task == "p2p" else come >= config.sparse_distance
        observation = self.observe()
        fell = self._frame[8] < self.upright
        terminated = bool((success and self.ends) or fell)
        reward = float(success)
        if config.reward == "dense":
            reward = min(max(config.progress_weight * (come - before), -CLIP), CLIP)
            reward -= config.effort_weight * float(action @ action) / len(action)
            reward += config.goal_bonus * (success and self.ends) - config.fall_penalty * fell
        return observation, reward, terminated, self.steps >= config.episode_steps and not terminated

    def distance(self) -> float:
        """How far the robot has come, m, up to a constant of the episode."""
        x, y = self.data.qpos[:2]
        if self.task == "x":
            return x
        return float(np.hypot(x, y)) if self.task == "xy" else -float(np.hypot(self.goal[0] - x, self.goal[1] - y))

    def observe(self) -> np.ndarray:
        """The observation f32[O] of the present state; leaves the rotation, body to world, in `_frame`."""
        qpos, qvel = self.data.qpos, self.data.qvel
        mujoco.mju_quat2Mat(self._frame, qpos[3:7])
        frame = self._frame
        x, y = qpos[:2]
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
        parts = [head, -frame[6:9], self.felt * (qpos[7:] - self.stance[7:])]
        if self.config.observation == "full":
            velocity = qvel[:3] @ frame.reshape(3, 3)
            parts += [velocity, 0.3 * qvel[3:6], 0.1 * self.felt * qvel[6:], 10.0 * qpos[2:3]]
        return np.concatenate(parts, dtype=np.float32)
