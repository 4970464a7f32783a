"""DDPG of Stable-Baselines3 (torch) and of SBX (its JAX twin) on the robot as a Gymnasium environment.

As equal to this package's DDPG as their settings allow: batch, replay, discount, rates of learning and of the targets,
widths, two critics, ten environments a seed, ten mini-batches for the critics to one for the actor every twenty
environment steps, correlated noise. What they do otherwise: the smaller of two target critics and not their mean, SBX's
actor and both of SB3's networks without LayerNorm, SBX follows the actor with its target at every mini-batch and SB3
the critics at every tenth, before the first update actions are random. Imports torch: only processes that need it may
import this module.
"""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import stable_baselines3 as sb3  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import DummyVecEnv  # pyright: ignore[reportMissingImports]

from experiments.contenders.measuring import Runner
from srl_jax.config import Config
from srl_jax.standard.gym import Hexapod

Run = tuple[int, str]  # seed and damage


def model(library: str, config: Config, run: Run) -> Any:
    """DDPG of ``sbx`` or ``sb3`` before its first step."""
    agent, train, (seed, damage) = config.ddpg, config.train, run
    actions, correlation = np.zeros(18), agent.noise_correlation[0]
    size = agent.noise[0] * np.sqrt(1.0 - correlation**2) * np.ones_like(actions)
    common: dict[str, Any] = dict(
        policy="MlpPolicy",
        env=DummyVecEnv([partial(Hexapod, config.task, damage, settings=config.env)] * train.environments),
        buffer_size=train.capacity,
        learning_starts=train.warmup,
        batch_size=agent.batch,
        tau=agent.tau[0],
        gamma=agent.gamma[0],
        train_freq=(train.update_every, "step"),
        gradient_steps=agent.critic_updates,
        action_noise=OrnsteinUhlenbeckActionNoise(actions, size, theta=1.0 - correlation, dt=1.0),
        seed=seed,
        device="cpu",
    )
    networks: dict[str, Any] = dict(net_arch=list(agent.hidden), n_critics=agent.critics)
    if library == "sbx":
        import sbx  # pyright: ignore[reportMissingImports]

        rates = dict(learning_rate=agent.actor_lr[0], qf_learning_rate=agent.critic_lr[0])
        made = sbx.DDPG(**common, **rates, policy_kwargs=networks | {"layer_norm": agent.layer_norm})
    else:
        made = sb3.DDPG(**common, learning_rate=agent.critic_lr[0], policy_kwargs=networks)
    made.policy_delay = agent.critic_updates  # which DDPG's own arguments leave out
    for rows in vars(made.replay_buffer).values():
        if isinstance(rows, np.ndarray):
            rows.fill(0)  # or its memory is only promised, and not counted
    return made


def runner(library: str, config: Config, runs: Sequence[Run], steps: int) -> Runner:
    """Trains `runs` one after the other.

    Where `steps` falls short of a whole run, only so many environment steps of the first of them, in the midst of
    learning, and a second one is begun before, to see what beginning anew costs once all is imported and compiled.
    """
    if library == "sb3":
        import torch  # pyright: ignore[reportMissingImports]

        torch.set_num_threads(1)  # more only slow such small networks down
    if steps >= config.steps:

        def whole() -> None:
            for run in runs:
                model(library, config, run).learn(config.steps, log_interval=None)

        return Runner(whole, len(runs) * config.steps, {"whole": True})
    done = config.train.warmup + config.train.environments * config.train.update_every
    first = model(library, config, runs[0]).learn(done, log_interval=None)
    began = time.perf_counter()
    model(library, config, runs[-1]).learn(done, log_interval=None)
    facts = {"done": done, "again_seconds": time.perf_counter() - began, "again_in_start": True}
    return Runner(lambda: first.learn(steps, log_interval=None, reset_num_timesteps=False), steps, facts)
