"""The agents on Pendulum-v1, from the same act, update and replay as on the robot: ``python -m experiments.pendulum``."""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import tyro

from srl_jax import replay
from srl_jax.agents import ddpg, hyper, srl
from srl_jax.bayes import controller
from srl_jax.config import DDPGConfig, SRLConfig
from srl_jax.types import ActState, Transition

EPISODE, EPISODES, BATCH = 200, 20, 128
COMMON = dict(critics=1, layer_norm=False, actor_lr=(1e-3,), gamma=(0.98,), tau=(0.005,), freeze=(1_000.0,))
AGENTS = {
    "ddpg": (ddpg, DDPGConfig(**COMMON)),
    "srl": (srl, SRLConfig(init="random", dropout=(0.1,), **COMMON)),
}


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
    reward = -(angle**2 + 0.1 * state[1] ** 2 + 0.001 * torque**2)
    return jnp.stack([angle + 0.05 * speed, speed]), reward


def swing_up(observation: jax.Array) -> jax.Array:
    """A teacher: pumps energy until upright is in reach, then holds there by proportional-derivative control."""
    cosine, sine, speed = observation
    pump = speed * (5.0 - 5.0 * cosine - speed**2 / 6.0)
    return jnp.clip(jnp.where(cosine > 0.9, -4.0 * sine - speed, 0.5 * pump)[None], -1.0, 1.0)


def evaluate(policy, key: jax.Array) -> jax.Array:
    """Mean return of a policy f32[3] -> f32[1], noise-free: f32[]."""
    starts = jax.vmap(reset)(jax.random.split(key, EPISODES))
    _, rewards = jax.lax.scan(
        lambda s, _: jax.vmap(step)(s, policy(jax.vmap(observe)(s))), starts, length=EPISODE
    )
    return rewards.sum(0).mean()


def train(key: jax.Array, *, agent, config: DDPGConfig, steps: int) -> jax.Array:
    """Trains one seed, one update a step, and returns what the student alone earns."""
    settings = dict(config=config, hyper=hyper.from_config(config), teachers=(swing_up,))
    init_key, run_key, test_key = jax.random.split(key, 3)

    def advance(carry, t: jax.Array):
        learner, memory, *moving = carry
        reset_key, act_key, batch_key, update_key = jax.random.split(jax.random.fold_in(run_key, t), 4)
        fresh = [ActState(jnp.zeros(1), controller.init()), reset(reset_key)]
        acting, state = jax.tree.map(partial(jnp.where, t % EPISODE == 0), fresh, moving)
        action, acting = agent.act(learner, acting, observe(state), act_key, step=t, **settings)
        after, reward = step(state, action)
        chosen = acting.guidance.choice.astype(jnp.float32)
        new = Transition(observe(state), action, reward, jnp.ones(()), observe(after), chosen)
        memory = replay.add(memory, jax.tree.map(lambda x: x[None], new), t)
        batch = replay.sample(memory, t + 1, BATCH, batch_key, 3)
        learner, _ = agent.update(learner, batch, update_key, step=t, **settings)
        return (learner, memory, acting, after), None

    moving = ActState(jnp.zeros(1), controller.init()), jnp.zeros(2)
    carry = agent.init(init_key, 3, 1, config=config), replay.init(steps, 3, 1), *moving
    (learner, *_), _ = jax.lax.scan(advance, carry, jnp.arange(steps))
    return evaluate(partial(ddpg.student, learner.actor, config=config), test_key)


def main(algo: Literal["ddpg", "srl"] = "ddpg", seeds: int = 10, steps: int = 30_000) -> None:
    """Trains every seed in one program and prints the returns."""
    agent, config = AGENTS[algo]
    run = jax.jit(jax.vmap(partial(train, agent=agent, config=config, steps=steps)))
    returns = run(jax.vmap(jax.random.key)(jnp.arange(seeds)))
    print(
        f"{algo}: {returns.mean():.0f} ± {returns.std():.0f}; by seed", *(f"{value:.0f}" for value in returns)
    )


if __name__ == "__main__":
    tyro.cli(main)
