"""A training loop for `vmap` over seeds, as PureJaxRL and rejax have them: physics by MJX, the update this package's.

One seed's loop is written down once, unbatched; `vmap` makes it that of all seeds, on whatever one process has. The
damage is an argument, so that one compilation serves all. The replay is a matrix of whole transitions.
"""

import dataclasses
import time
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from experiments.contenders.measuring import Runner
from srl_jax.agents import hyper, noise, registry
from srl_jax.bayes import controller
from srl_jax.config import Config
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import ACTION_SIZE, EnvState
from srl_jax.job.teachers import scripted_gait
from srl_jax.types import ActState, Transition


class Carry(NamedTuple):
    """One seed: E robots, W floats in a transition."""

    agent: Any
    memory: jax.Array  # f32[C, W]
    env: EnvState  # leaves [E, ...]
    acting: ActState  # leaves [E, ...]
    observation: jax.Array  # f32[E, O]


class Loop:
    """The functions of one seed; what is not an argument is the same for all."""

    def __init__(self, config: Config):
        settings = dataclasses.replace(config.env, physics="mjx")
        self.train, self.config = config.train, config.ddpg
        self.agent: Any = registry.agent(config.ddpg)
        self.hyper = hyper.from_config(config.ddpg)
        self.robot = hexapod.make(config.task, settings, scripted_gait().clock_hz)
        self.size = hexapod.observation_size(config.task, config.env)

    def start(self, key: jax.Array, damage: Damage) -> Carry:
        """A seed before its first step."""
        agent_key, robot_key = jax.random.split(key)
        agent = self.agent.init(agent_key, self.size, ACTION_SIZE)
        memory = jnp.zeros((self.train.capacity, 2 * self.size + ACTION_SIZE + 2))
        return Carry(agent, memory, *self.fresh(robot_key, damage))

    def fresh(self, key: jax.Array, damage: Damage) -> tuple[EnvState, ActState, jax.Array]:
        """Robots at the start of an episode."""

        def robot(key: jax.Array):
            env, observation = hexapod.reset(self.robot, damage, key)
            return env, ActState(noise.start(key, ACTION_SIZE), controller.init()), observation

        return jax.vmap(robot)(jax.random.split(key, self.train.environments))

    def collect(self, carry: Carry, key: jax.Array, damage: Damage, clock: jax.Array) -> Carry:
        """One step of all robots of a seed, remembered."""
        act_key, reset_key = jax.random.split(key)
        act = partial(self.agent.act, carry.agent, hyper=self.hyper, step=clock.astype(jnp.float32))
        keys = jax.random.split(act_key, self.train.environments)
        action, acting = jax.vmap(lambda *row: act(*row))(carry.acting, carry.observation, keys)
        env, step = jax.vmap(partial(hexapod.step, self.robot, damage))(carry.env, action)
        facts = jnp.stack([step.reward, 1.0 - step.terminated], axis=1)
        rows = jnp.concatenate([carry.observation, step.observation, action, facts], axis=1)
        memory = jax.lax.dynamic_update_slice_in_dim(carry.memory, rows, clock % self.train.capacity, axis=0)
        done = step.terminated | step.truncated

        def pick(new: jax.Array, start: jax.Array) -> jax.Array:
            return jnp.where(done.reshape(-1, *(1,) * (new.ndim - 1)), start, new)

        world = jax.tree.map(pick, (env, acting, step.observation), self.fresh(reset_key, damage))
        return Carry(carry.agent, memory, *world)

    def learn(self, carry: Carry, key: jax.Array, clock: jax.Array) -> Carry:
        """One update of a seed's agent."""
        draw_key, update_key = jax.random.split(key)
        filled = jnp.minimum(clock, self.train.capacity)
        batch = carry.memory[jax.random.randint(draw_key, (self.agent.batch_size,), 0, filled)]
        size, none = self.size, jnp.zeros(len(batch))
        transition = Transition(
            observation=batch[:, :size],
            next_observation=batch[:, size : 2 * size],
            action=batch[:, 2 * size : -2],
            reward=batch[:, -2],
            discount=batch[:, -1],
            chosen=none,
            lot=none,
        )
        step = clock.astype(jnp.float32)
        return carry._replace(
            agent=self.agent.update(carry.agent, transition, update_key, hyper=self.hyper, step=step)[0]
        )

    def go(self, carry: Carry, key: jax.Array, damage: Damage, clock: jax.Array, count: jax.Array, learning: jax.Array):
        """`count` times the vector steps from one update to the next, with the update where there is `learning`."""
        every, environments = self.train.update_every, self.train.environments

        def once(number: jax.Array, carry: Carry) -> Carry:
            now = clock + number * every * environments
            keys = jax.random.split(jax.random.fold_in(key, now), every + 1)
            for turn in range(every):
                carry = self.collect(carry, keys[turn], damage, now + turn * environments)
            return jax.lax.cond(
                learning, lambda c: self.learn(c, keys[-1], now + every * environments), lambda c: c, carry
            )

        return jax.lax.fori_loop(0, count, once, carry)


def runner(config: Config, seeds: Sequence[int], names: Sequence[str], steps: int) -> Runner:
    """Trains all seeds at once, under one damage after the other; of less than a whole run only a part of the first.

    Args:
        config: of the run.
        seeds: as they are.
        names: of damages.
        steps: environment steps of each seed; fewer than a whole run's are in the midst of learning.
    """
    loop, clock = Loop(config), 0
    key, each = jax.vmap(jax.random.key)(jnp.array(seeds)), config.train.update_every * config.train.environments
    damage = {name: jax.tree.map(jnp.asarray, damages.build(name)) for name in names}
    start = jax.jit(jax.vmap(loop.start, (0, None)))
    go = jax.jit(jax.vmap(loop.go, (0, 0, None, None, None, None)), donate_argnums=0)

    def advance(carry: Carry, name: str, count: int, learning: bool) -> Carry:
        nonlocal clock
        carry = go(carry, key, damage[name], jnp.int32(clock), jnp.int32(count // each), jnp.bool_(learning))
        clock += count
        return jax.block_until_ready(carry)

    def begin(name: str) -> Carry:
        nonlocal clock
        clock = 0
        return advance(advance(start(key, damage[name]), name, config.train.warmup, False), name, each, True)

    done = config.train.warmup + each
    if steps >= config.steps:

        def whole() -> None:
            for name in names:
                advance(begin(name), name, config.steps - done, True)

        return Runner(whole, len(names) * len(seeds) * config.steps, {"whole": True})
    begin(names[0])
    began = time.perf_counter()
    carry = begin(names[-1])
    facts = {"done": done, "again_seconds": time.perf_counter() - began, "again_in_start": True}

    def run() -> None:
        nonlocal carry
        carry = advance(carry, names[-1], steps, True)

    return Runner(run, steps * len(seeds), facts)
