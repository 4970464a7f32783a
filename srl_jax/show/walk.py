"""A walk in C MuJoCo: pi_B walks the healthy robot, its damage strikes in mid-stride, and a policy walks on.

Physics has settings that leave no error worth naming (2 ms, 50 iterations); observations and ends are as in training.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import NamedTuple

import jax
import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.evaluate import converged_model
from srl_jax.show.walker import Kind, Walker, tripod


class Moment(NamedTuple):
    """The robot after a control step of 1/20 s."""

    qpos: np.ndarray  # f64[25]
    damage: str  # in force
    walker: str  # who acted
    goal: np.ndarray  # f64[2] m; zeros where the task has none
    reached: int  # goals so far
    fell: bool  # tipped over


class Walk:
    """One robot, step by step; where a goal is reached the next is drawn about it."""

    def __init__(self, walker: Walker, damage: str, strike: int, seed: int = 0) -> None:
        """A robot in its stance.

        Args:
            walker: who walks once the damage has struck.
            damage: a name of `damage_names`.
            strike: control steps under pi_B before it; 0: the robot is damaged from the start.
            seed: of the start and the goals.

        Raises:
            ValueError: for a bad damage name.
        """
        self.damage, self.strike, self.steps, self.reached = damage, strike, 0, 0
        self._names, self._models = (HEALTHY, damage), [converged_model(name) for name in (HEALTHY, damage)]
        self._damages = [damages.build(name) for name in self._names]
        self._walkers = (tripod(walker.task, walker.clock_hz, walker.kind), walker)
        self._do = _functions(walker.task, walker.kind, walker.clock_hz)
        self._random = np.random.default_rng(seed)
        self._state, self._seen = self._do.reset(self._damages[self.broken], jax.random.key(seed))
        self.data = mujoco.MjData(self._models[self.broken])
        self.data.qpos[:] = self._state.qpos
        mujoco.mj_forward(self._models[self.broken], self.data)

    @property
    def broken(self) -> bool:
        """Whether the damage has struck."""
        return self.steps >= self.strike

    def step(self) -> Moment:
        """One control step; `data` is then that of its end."""
        broken = self.broken
        model, damage, walker = (own[broken] for own in (self._models, self._damages, self._walkers))
        action = np.clip(walker.act(np.asarray(self._seen)), -1.0, 1.0)
        self.data.ctrl[:] = self._do.targets(action)
        mujoco.mj_step(model, self.data, nstep=round(1.0 / (CONTROL_HZ * model.opt.timestep)))
        self.steps += 1
        before = self._state
        after = before._replace(qpos=self.data.qpos.astype(np.float32), qvel=self.data.qvel.astype(np.float32))
        self._state, out = self._do.advance(damage, before, after, action)
        goal, self._seen = np.asarray(before.goal, np.float64), out.observation
        if walker.task == "p2p" and out.success:
            self.reached += 1
            self._state = self._state._replace(goal=self._next_goal())
            self._seen = self._do.observe(damage, self._state)
        return Moment(self.data.qpos.copy(), self._names[broken], walker.name, goal, self.reached, bool(out.fell))

    def until(self, steps: int) -> Iterator[Moment]:
        """So many steps, or fewer where it falls."""
        for _ in range(steps):
            moment = self.step()
            yield moment
            if moment.fell:
                return

    def _next_goal(self) -> np.ndarray:
        radius, angle = self._random.uniform(*EnvConfig().goal_ring), self._random.uniform(-np.pi, np.pi)
        return np.asarray(self.data.qpos[:2] + radius * np.array([np.cos(angle), np.sin(angle)]), np.float32)


class _Functions(NamedTuple):
    """Those of the environment, compiled once for all walks of a kind."""

    reset: Callable
    advance: Callable
    observe: Callable
    targets: Callable


@cache
def _functions(task: str, kind: Kind, clock_hz: float) -> _Functions:
    robot = hexapod.make(task, EnvConfig(observation=kind, physics="mjx"), clock_hz)
    names = ("reset", "advance", "observe", "targets")
    return _Functions(*(jax.jit(partial(getattr(hexapod, name), robot)) for name in names))
