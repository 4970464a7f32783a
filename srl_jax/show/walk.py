"""A walk in C MuJoCo: pi_B walks the healthy robot, its damage strikes in mid-stride, and a policy walks on.

Physics has settings that leave no error worth naming (2 ms, 50 iterations) unless told otherwise; observations and ends
are as in training.
"""

import math
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import NamedTuple

import jax
import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import ACTION_SIZE, CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.evaluate import converged_model
from srl_jax.show.walker import Kind, Walker, tripod

STANDS = "stands"  # the name of nobody


class Moment(NamedTuple):
    """The robot after a control step of 1/20 s."""

    qpos: np.ndarray  # f64[25]
    damage: str  # in force
    walker: str  # who acted; `STANDS`: nobody
    goal: np.ndarray  # f64[2] m; zeros where the task has none
    reached: int  # goals so far
    fell: bool  # tipped over


class Walk:
    """One robot, step by step; where a goal is reached the next is drawn about it."""

    def __init__(
        self,
        walker: Walker,
        damage: str,
        strike: int,
        seed: int = 0,
        *,
        before: Walker | None = None,
        unaware: int = 0,
        rest: int = 0,
        model: Callable[[str], mujoco.MjModel] = converged_model,
    ) -> None:
        """A robot in its stance.

        Args:
            walker: who walks in the end.
            damage: a name of `damage_names`.
            strike: control steps before it strikes; 0: the robot is damaged from the start.
            seed: of the start and the goals.
            before: who walks until then; None: pi_B.
            unaware: control steps after the strike that who walked before goes on.
            rest: control steps that the robot then stands. Where it does, the walker's clock begins anew, and on task x
                it walks where the robot has come to look.
            model: of a damaged robot, by its name.

        Raises:
            ValueError: for a bad damage name.
        """
        self.damage, self.strike, self.steps, self.reached = damage, strike, 0, 0
        self._takes_over, self._rest = strike + unaware, rest
        self.heading = 0.0  # rad about the vertical, where task x leads
        self._names, self._models = (HEALTHY, damage), [model(name) for name in (HEALTHY, damage)]
        self._damages = [damages.build(name) for name in self._names]
        self._walkers = (before or tripod(walker.task, walker.clock_hz, walker.kind), walker)
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

    @property
    def phase(self) -> float:
        """Of the gait's clock, in [0, 1)."""
        return float(self._state.phase)

    def step(self) -> Moment:
        """One control step; `data` is then that of its end."""
        broken, (name, action) = self.broken, self._acts()
        model, damage = self._models[broken], self._damages[broken]
        self.data.ctrl[:] = self._do.targets(action)
        mujoco.mj_step(model, self.data, nstep=round(1.0 / (CONTROL_HZ * model.opt.timestep)))
        self.steps += 1
        before = self._state
        after = before._replace(qpos=self.data.qpos.astype(np.float32), qvel=self.data.qvel.astype(np.float32))
        self._state, out = self._do.advance(damage, before, after, action)
        goal, self._seen = np.asarray(before.goal, np.float64), out.observation
        if self._walkers[1].task == "p2p" and out.success:
            self.reached += 1
            self._state = self._state._replace(goal=self._next_goal())
            self._seen = self._do.observe(damage, self._state)
        return Moment(self.data.qpos.copy(), self._names[broken], name, goal, self.reached, bool(out.fell))

    def _acts(self) -> tuple[str, np.ndarray]:
        """Who acts now, and the action f32[18]."""
        aware = self.steps - self._takes_over
        if 0 <= aware < self._rest:
            return STANDS, np.zeros(ACTION_SIZE, np.float32)
        if aware == self._rest > 0:
            self._state = self._state._replace(phase=np.float32(0.0))
            self._seen = self._do.observe(self._damages[self.broken], self._state)
            if self._walkers[1].task == "x":
                self.heading = -math.atan2(self._seen[3], self._seen[2])  # of what is ahead and to the left
        walker = self._walkers[aware >= self._rest]
        return walker.name, np.clip(walker.act(self._facing(np.array(self._seen))), -1.0, 1.0)

    def _facing(self, seen: np.ndarray) -> np.ndarray:
        """The observation with its direction, ahead and left, turned to the heading."""
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        seen[2:4] = cosine * seen[2] - sine * seen[3], sine * seen[2] + cosine * seen[3]
        return seen

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
