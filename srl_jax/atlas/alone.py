"""One policy walks robots that only `reset` and `step`: it has no atlas, and must feel itself what became of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from srl_jax.atlas.robots import Robot
from srl_jax.env import history as histories
from srl_jax.env import senses as feeling
from srl_jax.env.hexapod import CONTROL_HZ, Hexapod
from srl_jax.env.senses import Senses


class Memory(NamedTuple):
    """What a walker carries from step to step."""

    phase: jax.Array  # f32[] of the gait's clock
    history: jax.Array | None  # f32[K, R + 18], see `env.history`


@dataclass(frozen=True)
class Walker:
    """What a policy sees of a robot; equal ones share what jax has compiled."""

    task: str
    kind: str
    steps: int  # of history
    clock_hz: float

    def begin(self, key: jax.Array) -> Memory:
        """Before the first step: at any phase, with nothing behind it."""
        return Memory(jax.random.uniform(key), histories.none(self.steps, self.kind))

    def observe(self, memory: Memory, senses: Senses) -> jax.Array:
        """The observation f32[O] that training gives at the same senses; of a robot's sensors, onboard or rates."""
        return feeling.observation(senses, memory.phase, task=self.task, kind=self.kind, history=memory.history)

    def act(self, policy: Partial, memory: Memory, senses: Senses) -> tuple[Memory, jax.Array]:
        """One control step: the policy's action f32[18], and what is carried on."""
        action = policy(self.observe(memory, senses))
        history = memory.history
        if history is not None:
            history = histories.push(history, feeling.reading(senses, kind=self.kind), action)
        return Memory(jnp.mod(memory.phase + self.clock_hz / CONTROL_HZ, 1.0), history), action


def walker(robot: Hexapod) -> Walker:
    """What policies see that were trained on a robot."""
    return Walker(robot.task, robot.config.observation, robot.config.history, robot.clock_hz)


@partial(jax.jit, static_argnames="walker")
def _begin(keys: jax.Array, *, walker: Walker) -> Memory:
    return jax.vmap(walker.begin)(keys)


@partial(jax.jit, static_argnames="walker", donate_argnames="memory")
def _act(policies: Partial, memory: Memory, senses: Senses, *, walker: Walker) -> tuple[Memory, jax.Array]:
    return jax.vmap(walker.act)(policies, memory, senses)


def walk(walker: Walker, policies: Partial, robots: Sequence[Robot], *, seconds: float, seed: int = 0) -> np.ndarray:
    """Walks robots for some seconds, side by side; returns what they did, f32[T, N, 18].

    Args:
        walker: what the policies see.
        policies: a policy for each robot, observation f32[O] -> action f32[18], leaves [N, ...].
        robots: N that can `reset` and `step`.
        seconds: of robot time.
        seed: of their clocks.

    Raises:
        ValueError: the policies see what no robot senses.
    """
    memory = _begin(jax.random.split(jax.random.key(seed), len(robots)), walker=walker)
    senses, done = [robot.reset() for robot in robots], []
    for _ in range(round(seconds * CONTROL_HZ)):
        felt = jax.tree.map(lambda *rows: np.stack(rows), *senses)
        memory, action = _act(policies, memory, felt, walker=walker)
        done.append(np.asarray(action))
        senses = [robot.step(own) for robot, own in zip(robots, done[-1], strict=True)]
    return np.stack(done)
