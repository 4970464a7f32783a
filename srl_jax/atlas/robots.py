"""Robots to recover on: C MuJoCo at settings that leave no error worth naming, on another floor, with noisy sensors."""

from dataclasses import dataclass, field
from typing import Protocol

import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, UPRIGHT
from srl_jax.env.model import stance
from srl_jax.env.senses import NOISE, Senses
from srl_jax.evaluate import converged_model


class Robot(Protocol):
    """What `recovery.run` needs to know of a robot: neither its damage nor its physics."""

    def reset(self) -> Senses:
        """Stands at the start; what it feels."""
        ...

    def step(self, action: np.ndarray) -> Senses:
        """One control step of 1/20 s under an action f32[18] in [-1, 1]; what it feels then."""
        ...


@dataclass(frozen=True)
class World:
    """How a robot differs from the one that the atlas was made with."""

    friction: float = 0.8  # share of the model's
    mass: float = 1.0  # share of every link's
    gain: float = 1.0  # share of the servos' stiffness
    noise: float = 1.0  # times `NOISE`


@dataclass
class CRobot:
    """A robot that walks straight ahead along x, healthy until its damage strikes."""

    damage: str
    strike: int  # control steps until the damage
    seed: int = 0
    world: World = World()
    positions: list[np.ndarray] = field(default_factory=list)  # f64[25] after every step: for judges, not for the robot
    fell: bool = False

    def __post_init__(self) -> None:
        self._models = [self._model(damage_names.HEALTHY), self._model(self.damage)]
        self._present = [np.asarray(damages.present(damages.build(name))) for name in ("healthy", self.damage)]
        self._stance = stance(self._models[0])
        self._scale = np.tile(ACTION_SCALE, 6)
        self._substeps = round(1.0 / (CONTROL_HZ * self._models[0].opt.timestep))

    def _model(self, name: str) -> mujoco.MjModel:
        model = converged_model(name)
        model.geom_friction[:, 0] *= self.world.friction
        model.body_mass[:] *= self.world.mass
        model.body_inertia[:] *= self.world.mass
        model.actuator_gainprm[:, 0] *= self.world.gain
        model.actuator_biasprm[:, 1] *= self.world.gain
        return model

    def reset(self) -> Senses:
        """Stands at the origin, its joints a little off."""
        self._random = np.random.default_rng(self.seed)
        self._data = mujoco.MjData(self._models[0])
        self._data.qpos[:] = self._stance
        self._data.qpos[7:] += self._random.uniform(-0.05, 0.05, 18)
        self.positions, self.fell = [], False
        return self._senses()

    def step(self, action: np.ndarray) -> Senses:
        """One control step; the damage strikes before the step numbered `strike`, in mid-stride."""
        broken = len(self.positions) >= self.strike
        self._data.ctrl[:] = self._stance[7:] + self._scale * np.asarray(action)
        mujoco.mj_step(self._models[broken], self._data, nstep=self._substeps)
        self.positions.append(self._data.qpos.copy())
        self.fell |= bool(self._frame()[2, 2] < UPRIGHT)
        return self._senses()

    def _frame(self) -> np.ndarray:
        frame = np.empty(9)
        mujoco.mju_quat2Mat(frame, self._data.qpos[3:7])
        return frame.reshape(3, 3)

    def _senses(self) -> Senses:
        frame, present = self._frame(), self._present[len(self.positions) > self.strike]
        heading = frame[:2, 0] / max(float(np.linalg.norm(frame[:2, 0])), 1e-6)

        def noisy(name: str, value: np.ndarray) -> np.ndarray:
            return value + self.world.noise * NOISE[name] * self._random.standard_normal(value.shape)

        joints = noisy("joints", self._data.qpos[7:] - self._stance[7:])
        speeds = noisy("speeds", self._data.qvel[6:])
        return Senses(
            joints=np.where(present, joints, 0.0).astype(np.float32),
            speeds=np.where(present, speeds, 0.0).astype(np.float32),
            answering=present,
            gyroscope=noisy("gyroscope", self._data.qvel[3:6]).astype(np.float32),
            gravity=noisy("gravity", -frame[2]).astype(np.float32),
            towards=np.array([heading[0], -heading[1]], np.float32),  # along x
            distance=np.array(2.0, np.float32),
            come=np.array(self._data.qpos[0], np.float32),
        )
