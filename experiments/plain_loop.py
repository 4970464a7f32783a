"""SRL's updates in a plain loop over a Gymnasium task: python -m experiments.plain_loop.

Nothing of the training program is used: a list of transitions as the replay, `srl.act`, `srl.update`, and a teacher,
which is a function of the observation.
"""

import dataclasses
from functools import partial
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.pendulum import CONFIGS, swing_up
from srl_jax.agents import hyper, noise, srl
from srl_jax.bayes import controller
from srl_jax.types import ActState, Transition

CONFIG = dataclasses.replace(CONFIGS["srl"], hidden=(32, 32), batch=64)
SCALE = 2.0  # of Pendulum's action; agents act in [-1, 1]


def train(steps: int = 3_000, seed: int = 0) -> tuple[srl.AgentState, list[float]]:
    """Trains for so many steps, an update each; returns what was learned, and the returns of the episodes."""
    env, random, key = gymnasium.make("Pendulum-v1"), np.random.default_rng(seed), jax.random.key(seed)
    size, actions = np.size(env.observation_space.sample()), np.size(env.action_space.sample())
    settings: Any = dict(config=CONFIG, hyper=hyper.from_config(CONFIG), teachers=(swing_up,))
    act, update = jax.jit(partial(srl.act, **settings)), jax.jit(partial(srl.update, **settings))
    state = srl.init(key, size, actions, config=CONFIG)
    observation, acting = None, ActState(jnp.zeros(actions), controller.init())
    memory: list[tuple[Any, ...]] = []  # in the order of `Transition`
    returns: list[float] = []
    for step in range(steps):
        act_key, update_key, start_key = jax.random.split(jax.random.fold_in(key, step), 3)
        if observation is None:  # an episode begins
            observation, _ = env.reset(seed=seed if step == 0 else None)
            acting = ActState(noise.start(start_key, actions), controller.init())
            returns.append(0.0)
        action, acting = act(state, acting, observation, act_key, step=step)
        action = np.asarray(action)
        reached, reward, terminated, truncated, _ = env.step(SCALE * action)
        chosen, lot = np.float32(acting.guidance.choice), np.float32(random.integers(2**24))
        memory.append((observation, action, np.float32(reward), np.float32(not terminated), reached, chosen, lot))
        returns[-1] += float(reward)
        observation = None if terminated or truncated else reached
        drawn = [memory[place] for place in random.integers(len(memory), size=CONFIG.batch)]
        batch = Transition(*(jnp.asarray(np.stack(rows)) for rows in zip(*drawn, strict=True)))
        state, _ = update(state, batch, update_key, step=step)
    return state, returns


def main(steps: int = 3_000, seed: int = 0) -> None:
    """Trains, and prints what the episodes earned."""
    print("Returns of the episodes:", *(f"{value:.0f}" for value in train(steps, seed)[1]))


if __name__ == "__main__":
    tyro.cli(main)
