"""SRL's rivals as settings of its code. This module imports no jax."""

from srl_jax.agents.settings import SRLConfig

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
