"""SRL's rivals as settings of its code: the same networks, critic updates and steps, another use of pi_B.

Each is the published use of a prior policy or of prior data in this package's actor-critic, not a copy of the published
program: what all of them share (ensemble, mini-batches, noise, optimisers) is what SRL has. This module imports no jax.
"""

from dataclasses import dataclass
from typing import Literal

from srl_jax.agents.settings import SRLConfig
from srl_jax.agents.sweep import NotNegative, Positive

NEVER = 1e30  # environment steps until something has decayed that does not: 1 - step / NEVER is 1 in f32

ACTEACH = SRLConfig(
    critics=1,
    critic_updates=1,
    init="random",
    noisy_proposals=True,
    shared_masks=False,
    critic_loss="alpha",
    dropout_update=True,
    dropout=(0.1,),
    guidance_weight=(0.0,),
    prior_fraction=(0.0,),
    draws=50,
)
"""AC-Teach (Kurenkov et al. 2019), SRL's parent: SRL without guidance, cloning or healthy replay."""

RLPD = SRLConfig(
    init="random",
    select=False,
    guidance_weight=(0.0,),
    prior_fraction=(0.5,),
    prior_decay=(NEVER,),
)
"""RLPD (Ball et al. 2023): half of every mini-batch are pi_B's healthy transitions, on average, from begin to end; no
other use of pi_B. Its LayerNorm and its many updates are everybody's."""

IBRL = SRLConfig(
    init="random",
    selection="greedy",
    noisy_proposals=True,
    behaviour_target=True,
    guidance_weight=(0.0,),
)
"""Imitation-bootstrapped RL (Hu et al. 2024): of the student's noisy action and pi_B's, the one acts that the mean
critic prefers, and of target actor and pi_B the one is bootstrapped from. pi_B is the frozen imitation policy."""


@dataclass(frozen=True)
class JumpStartConfig(SRLConfig):
    """Jump-start RL (Uchendu et al. 2023): pi_B acts at the start of every episode, the student after it."""

    init: Literal["random", "behaviour"] = "random"
    select: bool = False
    guidance_weight: NotNegative = (0.0,)
    jump_steps: NotNegative = (100.0,)
    """Control steps of an episode in which pi_B acts, at the beginning of training; they fall linearly to 0."""
    jump_decay: Positive = (20_000.0,)
    """Environment steps until jump_steps has fallen to 0."""
