"""A small run whose robots carry different damages and remember two control steps."""

import dataclasses

from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.program.settings import EvaluationConfig, TrainConfig

K = 2
MIX = ("leg_rf", "leg_lm", "healthy")


def config():
    base = preset("smoke")
    return dataclasses.replace(
        base,
        task="x",
        algos="srl",
        seeds="2",
        steps=40,
        damage_mix=",".join(MIX),
        train=TrainConfig(
            environments=4,
            capacity=160,
            warmup=16,
            evaluate_every=40,
            checkpoint_every=40,
            prior_steps=32,
            clone_updates=5,
        ),
        evaluation=EvaluationConfig(episodes=4),
        env=EnvConfig(observation="onboard", history=K, stride_starts=0.5, episode_steps=6),
        srl=dataclasses.replace(base.srl, hidden=(16,), batch=8, freeze=(16.0,)),
    )
