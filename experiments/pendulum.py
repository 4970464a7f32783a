"""The agents on Pendulum-v1, by the same act, update and replay as on the robot: python -m experiments.pendulum."""

from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import tyro

from srl_jax.agents import hyper, noise, registry
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.bayes import controller
from srl_jax.program import replay
from srl_jax.types import ActState, Transition

EPISODE, TESTS = 200, 20  # control steps, episodes of the final evaluation
SIZES = replay.Sizes(3, 1, EPISODE)
SHARED: Any = dict(critics=1, critic_updates=1, layer_norm=False, actor_lr=1e-3, gamma=0.98, tau=0.005, freeze=1e3)
CONFIGS = {"ddpg": DDPGConfig(**SHARED), "srl": SRLConfig(init="random", dropout=(0.1,), **SHARED)}


def reset(key: jax.Array) -> jax.Array:
    """The start: angle in rad, 0 upright, and speed in rad/s, f32[2]."""
    return jax.random.uniform(key, (2,), minval=-1.0) * jnp.array([jnp.pi, 1.0])


def observe(state: jax.Array) -> jax.Array:
    """f32[3]: cosine and sine of the angle, speed."""
    return jnp.stack([jnp.cos(state[0]), jnp.sin(state[0]), state[1]])


def step(state: jax.Array, action: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The state after 1/20 s under ``2 action`` N m, and the reward f32[] (Gymnasium's equations)."""
    angle, torque = (state[0] + jnp.pi) % (2.0 * jnp.pi) - jnp.pi, 2.0 * action[0]
    speed = jnp.clip(state[1] + 0.05 * (15.0 * jnp.sin(angle) + 3.0 * torque), -8.0, 8.0)
    return jnp.stack([angle + 0.05 * speed, speed]), -(angle**2 + 0.1 * state[1] ** 2 + 0.001 * torque**2)


def swing_up(observation: jax.Array) -> jax.Array:
    """A teacher: pumps energy until upright is in reach, then holds there by proportional-derivative control."""
    cos, sin, speed = observation
    return jnp.clip(jnp.where(cos > 0.9, -4 * sin - speed, speed * (2.5 - 2.5 * cos - speed**2 / 12))[None], -1, 1)


def episode_return(policy, key: jax.Array) -> jax.Array:
    """What a policy f32[3] -> f32[1] earns in one episode, noise-free: f32[]."""
    return jax.lax.scan(lambda s, _: step(s, policy(observe(s))), reset(key), length=EPISODE)[1].sum()


def train(seed: jax.Array, *, config: DDPGConfig, steps: int) -> jax.Array:
    """Trains one seed, one update a step, and returns what the student alone earns: f32[]."""
    agent: Any = registry.agent(config)
    settings: Any = dict(hyper=hyper.from_config(config), teachers=(swing_up,))
    init_key, run_key, test_key = jax.random.split(jax.random.key(seed), 3)

    def advance(carry, t: jax.Array):
        (learner, memory, *now), keys = carry, jax.random.split(jax.random.fold_in(run_key, t), 6)
        start = ActState(noise.start(keys[4], 1), controller.init())
        acting, state = jax.tree.map(partial(jnp.where, t % EPISODE == 0), [start, reset(keys[0])], now)
        action, acting = agent.act(learner, acting, observe(state), keys[1], step=t, **settings)
        (after, reward), chosen = step(state, action), 1.0 * acting.guidance.choice
        lot = 1.0 * jax.random.randint(keys[5], (), 0, 2**24)
        new = Transition(observe(state), action, reward, jnp.ones(()), observe(after), chosen, lot)
        cut = (t + 1) % EPISODE == 0
        new, cut, latest = jax.tree.map(lambda x: x[None], (new, cut, observe(after)))
        memory = replay.add(memory, new, cut, latest, t, episode_steps=EPISODE)
        batch = replay.draw(memory, t + 1, config.batch, keys[2], SIZES)
        return (agent.update(learner, batch, keys[3], step=t, **settings)[0], memory, acting, after), None

    idle = ActState(jnp.zeros(1), controller.init())
    carry = agent.init(init_key, 3, 1), replay.init(steps, 1, SIZES), idle, jnp.zeros(2)
    learner = jax.lax.scan(advance, carry, jnp.arange(steps))[0][0]
    earn = partial(episode_return, partial(agent.student, learner.actor))
    return jax.vmap(earn)(jax.random.split(test_key, TESTS)).mean()


def main(algo: Literal["ddpg", "srl"] = "ddpg", seeds: int = 10, steps: int = 30_000) -> None:
    """Trains every seed in one program and prints the returns."""
    returns = jax.jit(jax.vmap(partial(train, config=CONFIGS[algo], steps=steps)))(jnp.arange(seeds))
    print(f"{algo}: {returns.mean():.0f} ± {returns.std():.0f}; by seed", *(f"{value:.0f}" for value in returns))


if __name__ == "__main__":
    tyro.cli(main)
