"""Every setting of the agents, with its default and its reason to exist.

A field of type ``Sweep`` may hold several values: each value adds lanes, never another program. Everything else is
static and shapes the compiled program. This module imports no jax, so that ``--help`` answers at once.
"""

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.constructors import PrimitiveConstructorSpec


def _parse_sweep(args: list[str]) -> tuple[float, ...]:
    return tuple(float(part) for part in args[0].split(","))


Sweep = Annotated[
    tuple[float, ...],
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="FLOAT[,FLOAT...]",
        instance_from_str=_parse_sweep,
        is_instance=lambda x: isinstance(x, tuple) and all(isinstance(v, (int, float)) for v in x),
        str_from_instance=lambda x: [",".join(repr(v) for v in x)],
    ),
]


@dataclass(frozen=True)
class ActorConfig:
    """What every agent has that learns a network of an actor from a replay."""

    hidden: tuple[int, ...] = (64, 64)
    """Hidden widths of actor and critic."""
    layer_norm: bool = True
    """LayerNorm after each hidden layer."""
    batch: int = 128
    """Transitions in a mini-batch."""
    actor_optimiser: Literal["adam", "rmsprop"] = "adam"
    init: Literal["random", "behaviour"] = "random"
    """behaviour: the actor starts from pi_B's parameters (from cloning where pi_B is scripted)."""
    actor_lr: Sweep = (3e-4,)
    gamma: Sweep = (0.97,)
    """Discount."""
    noise: Sweep = (0.25,)
    """Standard deviation of the exploration noise at the start."""
    noise_decay: Sweep = (1.0,)
    """Factor of the noise's variance per environment step (the paper's 0.9999)."""
    noise_floor: Sweep = (0.05,)
    """Standard deviation below which the noise does not fall."""
    noise_correlation: Sweep = (0.85,)
    """Correlation of the noise from step to step; 0 is white."""
    freeze: Sweep = (2_000.0,)
    """Environment steps before the actor's first update, so that the critic has something to say."""

    def __post_init__(self) -> None:
        """A single number stands for a sweep of one value."""
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            if isinstance(entry.default, tuple) and isinstance(value, float):
                object.__setattr__(self, entry.name, (value,))


@dataclass(frozen=True)
class DDPGConfig(ActorConfig):
    """DDPG (Lillicrap et al. 2016) with an ensemble of critics and, optionally, a start from pi_B."""

    critics: int = 2
    """Members of the critic ensemble; targets and actor use their mean."""
    critic_updates: int = 2
    """Mini-batches the critic learns from in one update, to one of the actor."""
    critic_optimiser: Literal["adam", "rmsprop"] = "adam"
    critic_lr: Sweep = (1e-3,)
    tau: Sweep = (0.05,)
    """Rate of the target networks' soft update."""


@dataclass(frozen=True)
class SRLConfig(DDPGConfig):
    """Survivable robotic learning (Raza et al. 2021): the seven parts, each with its own switch."""

    init: Literal["random", "behaviour"] = "behaviour"
    select: bool = True
    """Thompson selection between the student's and the teachers' actions; off: the student always acts."""
    commit: bool = True
    """The controller commits to its last choice unless the posterior is sure enough; off: follow each sample."""
    estimator: Literal["paired", "gaussian"] = "paired"
    """How the probability that a switch is better is estimated from the draws."""
    fallback: Literal["previous", "actor"] = "previous"
    """Who acts when a switch is refused: the previous policy (the paper's prose) or the actor (its Algorithm 1)."""
    noisy_proposals: bool = False
    """Compare the student's action with its exploration noise, as AC-Teach does."""
    switch_rule: Literal["corrected", "acteach_release"] = "corrected"
    """acteach_release switches when the *current* policy is probably better, as that released code does."""
    shared_masks: bool = True
    """One posterior sample judges all proposals; off: independent masks per proposal (AC-Teach)."""
    draws: int = 12
    """Posterior samples per decision (a multiple of critics)."""
    guidance_draws: int = 4
    """Posterior samples that weigh the guidance at every state of a mini-batch (a multiple of critics)."""
    guidance_weighting: Literal["posterior", "mean", "annealed"] = "posterior"
    """What weighs the guidance at a state: the posterior probability that pi_B is better there, whether the mean critic
    says so (the Q-filter of Nair et al. 2018), or nothing but time, falling linearly to 0 at guidance_decay."""
    critic_loss: Literal["td", "alpha"] = "td"
    """td: squared error; alpha: AC-Teach's alpha-divergence over dropout samples."""
    dropout_update: bool = False
    """Fresh dropout masks in the critic's loss too; off: dropout only in the posterior's draws."""
    behaviour_target: bool = False
    """The TD target's next action is the better of target actor and teachers under the online critic."""
    dropout: Sweep = (0.02,)
    """Dropout rate of the posterior."""
    beta: Sweep = (0.6,)
    """Posterior probability needed to switch; decays with psi per refusal."""
    psi: Sweep = (0.99,)
    guidance_weight: Sweep = (10.0,)
    """Weight of the pull towards pi_B in the actor's loss, where the posterior favours pi_B; 0: off."""
    guidance_decay: Sweep = (20_000.0,)
    """Environment steps until annealed guidance reaches 0."""
    prior_fraction: Sweep = (0.0,)
    """Fraction of the mini-batch from healthy transitions at the start; decays linearly to 0."""
    prior_decay: Sweep = (20_000.0,)
    """Environment steps until prior_fraction reaches 0."""
    bootstrap: Sweep = (1.0,)
    """Probability that a transition enters one ensemble member's loss; 1: every member sees all."""
    weight_decay: Sweep = (0.0,)
    """Weight of the squared norm of the critic's parameters (the variational prior of dropout)."""
    alpha: Sweep = (0.5,)
    """Order of the alpha-divergence (critic_loss=alpha)."""
    precision: Sweep = (10.0,)
    """Observation precision of the alpha-divergence loss."""


ACTEACH = SRLConfig(
    init="random",
    noisy_proposals=True,
    shared_masks=False,
    critic_loss="alpha",
    dropout_update=True,
    dropout=(0.1,),
    guidance_weight=(0.0,),
    prior_fraction=(0.0,),
    draws=24,
)
"""AC-Teach (Kurenkov et al. 2019), SRL's parent: SRL without guidance, cloning or healthy replay."""


@dataclass(frozen=True)
class FrozenConfig:
    """A policy that does not learn."""

    policy: Literal["behaviour", "tripod"] = "behaviour"
    """pi_B, or the tuned tripod gait whatever pi_B is."""


@dataclass(frozen=True)
class SearchConfig:
    """Episodic policy gradient over the gait's parameters (Ghavamzadeh & Engel 2006)."""

    estimator: Literal["monte_carlo", "model1", "model2"] = "monte_carlo"
    """Monte-Carlo's gradient, or that of Bayesian quadrature."""
    trajectories: int = 20
    """Episodes in one estimate (M)."""
    search_rate: Sweep = (1.0,)
    """Step along the natural gradient of standardised returns, in standard deviations of the search."""
    spread: Sweep = (0.2,)
    """Standard deviation of the parameters at the start, in units of action (1: a joint's full excursion)."""
    spread_floor: Sweep = (0.02,)
    """Standard deviation below which the search does not fall."""
    return_noise: Sweep = (0.5,)
    """Variance of the observation noise on standardised returns (Bayesian quadrature only)."""


@dataclass(frozen=True)
class ITEConfig:
    """Intelligent trial and error (Cully et al. 2015): map-based Bayesian optimisation after the damage."""

    repertoire: str = ""
    """The map, a file made by ``python -m srl_jax.repertoire``; empty: the one that ships with the package."""
    trials: int = 20
    """Gaits that are tried at most, an episode each."""
    rho: Sweep = (0.2,)
    """Length scale of the process over duty factors (0.4 as published: here one bad trial then spoils half the map)."""
    prior: Sweep = (1.0,)
    """Prior variance of a gait's fitness about the map, m^2."""
    trial_noise: Sweep = (1e-3,)
    """Variance of a trial about its gait's true fitness, m^2."""
    kappa: Sweep = (0.05,)
    """Weight of the standard deviation in the choice of the next gait."""
    sufficient: Sweep = (0.9,)
    """Share of the best expected fitness at which the search ends."""


@dataclass(frozen=True)
class BACConfig(ActorConfig):
    """Bayesian actor-critic (Ghavamzadeh & Engel 2007) with a Gaussian around a deterministic actor."""

    batch: int = 64
    """Transitions in a mini-batch, all of which meet in one Gaussian process."""
    init: Literal["random", "behaviour"] = "behaviour"
    actor_lr: Sweep = (3e-5,)
    noise_correlation: Sweep = (0.0,)
    kernel_length: Sweep = (10.0,)
    """Length scale of the critic's kernel of observations (whose components are of order one)."""
    value_scale: Sweep = (100.0,)
    """Prior variance of the value of a state."""
    advantage_scale: Sweep = (1.0,)
    """Prior variance of the advantage of an action."""
    reward_noise: Sweep = (0.1,)
    """Variance of a temporal difference about the process."""


AgentConfig = DDPGConfig | SRLConfig | BACConfig | FrozenConfig | SearchConfig | ITEConfig
