"""Robots to recover on: C MuJoCo at settings that leave no error worth naming, on another floor, with noisy sensors."""

from collections import deque
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, UPRIGHT
from srl_jax.env.model import stance
from srl_jax.env.senses import NOISE, Senses
from srl_jax.env.settings import EnvConfig
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
    payload: float = 0.0  # kg on the torso
    slope: float = 0.0  # degrees that it walks uphill
    delay: int = 0  # control steps until an action is taken
    lost: float = 0.0  # share of servos' packets that do not arrive, in either direction
    bias: float = 0.0  # of the inertial unit: so many standard deviations of `NOISE`, the same all along
    encoder: float = 0.0  # degrees that an encoder tells apart


@lru_cache(maxsize=128)
def _converged(name: str) -> mujoco.MjModel:
    """To be copied: reading a robot's description takes thirty times as long."""
    return converged_model(name)


@dataclass
class CRobot:
    """A robot that walks straight ahead along x, healthy until its damage strikes."""

    damage: str
    strike: int  # control steps until the damage
    seed: int = 0
    world: World = World()
    positions: list[np.ndarray] = field(default_factory=list)  # f64[25] after every step: for judges, not for the robot
    come: list[float] = field(default_factory=list)  # m along its task after every step, likewise
    fell: bool = False

    def __post_init__(self) -> None:
        self._models = [self._model(damage_names.HEALTHY), self._model(self.damage)]
        self._present = [np.asarray(damages.present(damages.build(name))) for name in ("healthy", self.damage)]
        self._stance = stance(self._models[0])
        self._scale = np.tile(ACTION_SCALE, 6)
        self._substeps = round(1.0 / (CONTROL_HZ * self._models[0].opt.timestep))

    def _model(self, name: str) -> mujoco.MjModel:
        model, world = copy(_converged(name)), self.world
        model.geom_friction[:, 0] *= world.friction
        model.body_mass[:] *= world.mass
        model.body_inertia[:] *= world.mass
        model.body_mass[1] += world.payload
        model.actuator_gainprm[:, 0] *= world.gain
        model.actuator_biasprm[:, 1] *= world.gain
        slope, weight = np.radians(world.slope), np.linalg.norm(model.opt.gravity)
        model.opt.gravity[:] = weight * np.array([-np.sin(slope), 0.0, -np.cos(slope)])
        return model

    def reset(self) -> Senses:
        """Stands at the origin, its joints a little off."""
        self._random = np.random.default_rng(self.seed)
        self._data = mujoco.MjData(self._models[0])
        self._data.qpos[:] = self._stance
        self._data.qpos[7:] += self._random.uniform(-0.05, 0.05, 18)
        self._data.ctrl[:] = self._stance[7:]
        self._waiting = deque([np.zeros(18)] * self.world.delay)
        self._bias = {name: self.world.bias * self._drawn(name, 3) for name in ("gyroscope", "gravity")}
        self.positions, self.come, self.fell = [], [], False
        return self._senses()

    def step(self, action: np.ndarray) -> Senses:
        """One control step; the damage strikes before the step numbered `strike`, in mid-stride."""
        broken = len(self.positions) >= self.strike
        self._waiting.append(np.asarray(action))
        wanted = self._stance[7:] + self._scale * self._waiting.popleft()
        self._data.ctrl[:] = np.where(self._lost(), self._data.ctrl, wanted)
        mujoco.mj_step(self._models[broken], self._data, nstep=self._substeps)
        self.positions.append(self._data.qpos.copy())
        self.fell |= bool(self._frame()[2, 2] < UPRIGHT)
        senses = self._senses()
        self.come.append(float(senses.come))
        return senses

    def _task(self) -> tuple[np.ndarray, float, float]:
        """Where its task is: the direction f64[2] in the world, m to a goal, and m come along it."""
        return np.array([1.0, 0.0]), 2.0, float(self._data.qpos[0])

    def _frame(self) -> np.ndarray:
        frame = np.empty(9)
        mujoco.mju_quat2Mat(frame, self._data.qpos[3:7])
        return frame.reshape(3, 3)

    def _drawn(self, name: str, size: int) -> np.ndarray:
        return NOISE[name] * self._random.standard_normal(size)

    def _lost(self) -> np.ndarray:
        """Whose packet is lost, bool[18]; without losses nothing is drawn."""
        return self._random.random(18) < self.world.lost if self.world.lost else np.zeros(18, bool)

    def _senses(self) -> Senses:
        frame, world = self._frame(), self.world
        heard = self._present[len(self.positions) > self.strike] & ~self._lost()
        heading = frame[:2, 0] / max(float(np.linalg.norm(frame[:2, 0])), 1e-6)
        (x, y), distance, come = self._task()
        joints = self._data.qpos[7:] - self._stance[7:]
        if world.encoder:
            joints = np.radians(world.encoder) * np.round(joints / np.radians(world.encoder))
        joints = joints + world.noise * self._drawn("joints", 18)
        speeds = self._data.qvel[6:] + world.noise * self._drawn("speeds", 18)
        gravity = self._models[0].opt.gravity @ frame / np.linalg.norm(self._models[0].opt.gravity)
        felt = {"gyroscope": self._data.qvel[3:6], "gravity": gravity}
        felt = {name: felt[name] + self._bias[name] + world.noise * self._drawn(name, 3) for name in felt}
        return Senses(
            joints=np.where(heard, joints, 0.0).astype(np.float32),
            speeds=np.where(heard, speeds, 0.0).astype(np.float32),
            answering=heard,
            gyroscope=felt["gyroscope"].astype(np.float32),
            gravity=felt["gravity"].astype(np.float32),
            towards=np.array([heading @ (x, y), heading[0] * y - heading[1] * x], np.float32),
            distance=np.array(distance, np.float32),
            come=np.array(come, np.float32),
        )


@dataclass
class GoalRobot(CRobot):
    """A robot that walks from goal to goal, each drawn about where it is when it reaches the last."""

    reached: int = 0

    def reset(self) -> Senses:
        """As `CRobot.reset`, with a first goal."""
        self._goals, self.reached, self._before = np.random.default_rng((self.seed, 1)), 0, 0.0
        self._goal, self._length = np.zeros(2), 0.0
        self._draw_goal(np.zeros(2))
        return super().reset()

    def _draw_goal(self, here: np.ndarray) -> None:
        radius, angle = self._goals.uniform(*EnvConfig().goal_ring), self._goals.uniform(-np.pi, np.pi)
        self._goal, self._length = here + radius * np.array([np.cos(angle), np.sin(angle)]), radius

    def _senses(self) -> Senses:
        """As `CRobot._senses`; at a goal the next one is drawn before."""
        _, left, come = self._task()
        if left < EnvConfig().goal_radius:
            self._before, self.reached = come, self.reached + 1
            self._draw_goal(self._data.qpos[:2].copy())
        return super()._senses()

    def _task(self) -> tuple[np.ndarray, float, float]:
        """As `CRobot._task`; what it has come towards all goals so far counts."""
        away = self._goal - self._data.qpos[:2]
        left = float(np.linalg.norm(away))
        return away / max(left, 1e-6), left, self._before + self._length - left


ROBOTS = {"x": CRobot, "p2p": GoalRobot}  # by the task of an atlas


class _Mjx(NamedTuple):
    """The functions of a simulated robot, compiled once for all of them."""

    begin: Callable
    step: Callable
    feel: Callable


@cache
def _mjx() -> _Mjx:
    robot = hexapod.make("x", EnvConfig(observation="onboard", physics="mjx"), 1.0)

    def step(damage: damages.Damage, state: hexapod.EnvState, action: jax.Array):
        reached, out = hexapod.step(robot, damage, state, action)
        return reached, out.fell

    begin = jax.jit(lambda damage, key: hexapod.reset(robot, damage, key)[0])
    return _Mjx(begin, jax.jit(step), jax.jit(partial(hexapod.feel, robot)))


@dataclass
class MjxRobot:
    """A robot of the physics that the atlas was trained in, with noisy sensors; otherwise as `CRobot`."""

    damage: str
    strike: int
    seed: int = 0
    positions: list[np.ndarray] = field(default_factory=list)
    come: list[float] = field(default_factory=list)
    fell: bool = False

    def __post_init__(self) -> None:
        self._each = [jax.tree.map(jnp.asarray, damages.build(name)) for name in (damage_names.HEALTHY, self.damage)]

    def reset(self) -> Senses:
        """Stands at the origin, its joints a little off."""
        self._random = np.random.default_rng(self.seed)
        self._state = _mjx().begin(self._each[0], jax.random.key(self.seed))
        self.positions, self.come, self.fell = [], [], False
        return self._senses(self._each[0])

    def step(self, action: np.ndarray) -> Senses:
        """One control step; the damage strikes before the step numbered `strike`, in mid-stride."""
        damage = self._each[len(self.positions) >= self.strike]
        self._state, fell = _mjx().step(damage, self._state, jnp.asarray(action))
        self.positions.append(np.asarray(self._state.qpos, np.float64))
        self.come.append(float(self._state.qpos[0]))
        self.fell |= bool(fell)
        return self._senses(damage)

    def _senses(self, damage: damages.Damage) -> Senses:
        senses = jax.device_get(_mjx().feel(damage, self._state))
        noisy = {name: getattr(senses, name) for name in NOISE}
        drawn = {name: self._random.standard_normal(noisy[name].shape) for name in NOISE}
        noisy = {name: (noisy[name] + NOISE[name] * drawn[name]).astype(np.float32) for name in NOISE}
        for name in ("joints", "speeds"):
            noisy[name] = np.where(senses.answering, noisy[name], 0.0).astype(np.float32)
        return senses._replace(**noisy)
