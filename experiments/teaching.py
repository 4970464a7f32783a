"""Where a teacher helps SRL and where not, on two of Gymnasium's tasks: python -m experiments.teaching.

Pendulum, and MountainCarContinuous, whose reward nobody finds who does not swing first. Each with a scripted teacher
that can do it and with one that cannot. The updates are the package's, the replay is one's own: arrays of transitions,
which `vmap` takes over the seeds with all else.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments import pendulum
from srl_jax import statistics
from srl_jax.agents import hyper, noise, registry
from srl_jax.agents.interface import Teacher
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.bayes import controller
from srl_jax.cli.ending import leave
from srl_jax.types import ActState, Transition

SHARED: Any = pendulum.SHARED | dict(hidden=(32, 32), batch=64)
SRL = SRLConfig(init="random", dropout=(0.1,), **SHARED)
METHODS = {
    "ddpg": DDPGConfig(**SHARED),
    "srl": SRL,
    "srl, unguided": dataclasses.replace(SRL, guidance_weight=(0.0,)),  # the teacher acts, and pulls nobody
    "srl, by time": dataclasses.replace(SRL, guidance_weighting="annealed", guidance_decay=(3_000.0,)),
}
TESTS = 10  # episodes by which a student is judged


class Task(NamedTuple):
    """A task of Gymnasium's in JAX; observations of order one, actions f32[1] in [-1, 1]."""

    reset: Callable[[jax.Array], jax.Array]  # key -> state
    observe: Callable[[jax.Array], jax.Array]  # state -> f32[O]
    step: Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array, jax.Array]]  # -> state, reward, terminated
    teachers: dict[str, Teacher]
    size: int  # O
    episode: int  # steps until time cuts it off
    scale: float  # of the reward that is learned from


def swing(state: jax.Array, action: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """MountainCarContinuous-v0 by its published equations: position (m) and speed (m/step) f32[2], force f32[1]."""
    force = jnp.clip(action[0], -1.0, 1.0)
    speed = jnp.clip(state[1] + 0.0015 * force - 0.0025 * jnp.cos(3.0 * state[0]), -0.07, 0.07)
    place = jnp.clip(state[0] + speed, -1.2, 0.6)
    speed = jnp.where((place <= -1.2) & (speed < 0.0), 0.0, speed)
    there = (place >= 0.45) & (speed >= 0.0)
    return jnp.stack([place, speed]), 100.0 * there - 0.1 * action[0] ** 2, there


TASKS = {
    "pendulum": Task(
        reset=pendulum.reset,
        observe=pendulum.observe,
        step=lambda state, action: (*pendulum.step(state, action), jnp.zeros((), bool)),
        teachers={"good": pendulum.swing_up, "poor": lambda seen: -jnp.clip(seen[2:], -1.0, 1.0)},  # slows it down
        size=3,
        episode=pendulum.EPISODE,
        scale=1.0,
    ),
    "mountain car": Task(
        reset=lambda key: jnp.stack([jax.random.uniform(key, minval=-0.6, maxval=-0.4), jnp.zeros(())]),
        observe=lambda state: jnp.stack([(state[0] + 0.3) / 0.9, state[1] / 0.07]),
        step=swing,
        teachers={"good": lambda seen: jnp.where(seen[1:] >= 0.0, 1.0, -1.0), "poor": lambda seen: jnp.ones(1)},
        size=2,
        episode=999,
        scale=0.1,
    ),
}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What to train."""

    tasks: tuple[str, ...] = tuple(TASKS)
    methods: tuple[str, ...] = tuple(METHODS)
    teachers: tuple[str, ...] = ("good", "poor")
    seeds: int = 5
    steps: int = 6_000
    """Environment steps of each seed, an update each."""


def episode_return(task: Task, policy: Teacher, key: jax.Array) -> jax.Array:
    """What a policy earns in one episode, without noise: f32[]."""

    def advance(carry, _):
        state, over = carry
        state, reward, there = task.step(state, policy(task.observe(state)))
        return (state, over | there), jnp.where(over, 0.0, reward)

    return jax.lax.scan(advance, (task.reset(key), jnp.zeros((), bool)), length=task.episode)[1].sum()


def train(seed: jax.Array, *, task: Task, config: DDPGConfig, teacher: Teacher, steps: int) -> jax.Array:
    """Trains one seed, and returns what the student alone earns after a half and all of the steps: f32[2]."""
    agent: Any = registry.agent(config)
    settings: Any = dict(hyper=hyper.from_config(config), teachers=(teacher,))
    init_key, run_key, test_key = jax.random.split(jax.random.key(seed), 3)
    idle = ActState(jnp.zeros(1), controller.init())
    seen, zero = jnp.zeros(task.size), jnp.zeros(())
    memory = Transition(seen, jnp.zeros(1), zero, zero, seen, zero, zero)
    memory = jax.tree.map(lambda x: jnp.zeros((steps, *x.shape)), memory)

    def advance(carry, t: jax.Array):
        (learner, memory, age, *now), keys = carry, jax.random.split(jax.random.fold_in(run_key, t), 6)
        start = ActState(noise.start(keys[4], 1), controller.init())
        acting, state = jax.tree.map(partial(jnp.where, age == 0), [start, task.reset(keys[0])], now)
        action, acting = agent.act(learner, acting, task.observe(state), keys[1], step=t, **settings)
        after, reward, there = task.step(state, action)
        lot = 1.0 * jax.random.randint(keys[5], (), 0, 2**24)
        goes_on, chosen = 1.0 - there, 1.0 * acting.guidance.choice
        new = Transition(task.observe(state), action, task.scale * reward, goes_on, task.observe(after), chosen, lot)
        memory = jax.tree.map(lambda rows, row: rows.at[t].set(row), memory, new)
        places = jax.random.randint(keys[2], (config.batch,), 0, t + 1)
        batch = jax.tree.map(lambda rows: rows[places], memory)
        learner, _ = agent.update(learner, batch, keys[3], step=t, **settings)
        age = jnp.where(there | (age + 1 == task.episode), 0, age + 1)
        return (learner, memory, age, acting, after), None

    def half(carry, number: jax.Array):
        carry, _ = jax.lax.scan(advance, carry, number * (steps // 2) + jnp.arange(steps // 2))
        earn = partial(episode_return, task, partial(agent.student, carry[0].actor))
        return carry, jax.vmap(earn)(jax.random.split(test_key, TESTS)).mean()

    begun = agent.init(init_key, task.size, 1), memory, jnp.int32(0), idle, task.reset(init_key)
    return jax.lax.scan(half, begun, jnp.arange(2))[1]


def main(arguments: Arguments) -> None:
    """Trains every seed of a method in one program, and prints interquartile means with 95 % intervals.

    Raises:
        ValueError: a name that is none, or too few seeds or steps.
    """
    for field, known in (("tasks", TASKS), ("methods", METHODS), ("teachers", ("good", "poor"))):
        if unknown := set(getattr(arguments, field)) - set(known):
            raise ValueError(f"{field} has {min(unknown)!r}: choose from {', '.join(known)}.")
    if arguments.seeds < 1 or arguments.steps < 2 or arguments.steps % 2:
        raise ValueError(f"seeds is {arguments.seeds} and steps {arguments.steps}: at least 1, and an even number.")
    print(f"| task | teacher | method | after {arguments.steps // 2:,} steps | after {arguments.steps:,} |")
    print("|---|---|---|---|---|")
    for name in arguments.tasks:
        task, keys = TASKS[name], jax.random.split(jax.random.key(0), 100)
        for level in arguments.teachers:
            teacher = task.teachers[level]
            alone = jax.vmap(partial(episode_return, task, teacher))(keys).mean()
            print(f"| {name} | {level} | the teacher alone | {alone:.0f} | {alone:.0f} |", flush=True)
            for method in arguments.methods:
                if method != "ddpg" or level == arguments.teachers[0]:  # which asks no teacher
                    how = partial(train, task=task, config=METHODS[method], teacher=teacher, steps=arguments.steps)
                    found = np.asarray(jax.jit(jax.vmap(how))(jnp.arange(arguments.seeds)))
                    print(f"| {name} | {level} | {method} | {cell(found[:, 0])} | {cell(found[:, 1])} |", flush=True)


def cell(returns: np.ndarray) -> str:
    """Interquartile mean and 95 % interval of one number a seed."""
    low, high = statistics.stratified_interval(returns[:, None])
    return f"{statistics.iqm(returns):.0f} [{low:.0f}, {high:.0f}]"


if __name__ == "__main__":
    import tyro

    leave(main, tyro.cli(Arguments))
