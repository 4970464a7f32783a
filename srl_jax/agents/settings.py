"""Every setting of the agents that ship, with its default, its range and its reason to exist.

This module imports no jax, so that ``--help`` answers at once.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from srl_jax.agents.sweep import AgentSettings, Count, NotNegative, Positive, Range, Share, Sweep

Correlation = Annotated[Sweep, Range(0.0, 0.999)]
Rate = Annotated[Sweep, Range(0.0, 0.99)]


@dataclass(frozen=True)
class ActorConfig(AgentSettings):
    """What every agent has that learns a network of an actor from a replay."""

    hidden: tuple[int, ...] = (64, 64)
    """Hidden widths of actor and critic."""
    layer_norm: bool = True
    """LayerNorm after each hidden layer."""
    batch: Count = 128
    """Transitions in a mini-batch."""
    actor_optimiser: Literal["adam", "rmsprop"] = "adam"
    init: Literal["random", "behaviour"] = "random"
    """behaviour: the actor starts from pi_B's parameters (from cloning where pi_B is scripted)."""
    actor_lr: NotNegative = (3e-4,)
    gamma: Share = (0.97,)
    """Discount."""
    noise: NotNegative = (0.25,)
    """Standard deviation of the exploration noise at the start."""
    noise_decay: Share = (1.0,)
    """Factor of the noise's variance per environment step (the paper's 0.9999)."""
    noise_floor: NotNegative = (0.05,)
    """Standard deviation below which the noise does not fall, unless it starts there."""
    noise_correlation: Correlation = (0.85,)
    """Correlation of the noise from step to step; 0 is white."""
    freeze: NotNegative = (2_000.0,)
    """Environment steps before the actor's first update, so that the critic has something to say."""

    @property
    def architecture(self) -> tuple[tuple[int, ...], bool]:
        """What two actors share where one can start from the other's parameters."""
        return self.hidden, self.layer_norm

    def check(self, name: str) -> None:
        """Also raises ValueError where a network has no layer or an empty one."""
        super().check(name)
        if not self.hidden or min(self.hidden) < 1:
            raise ValueError(f"{name}.hidden is {self.hidden}: give at least one width, each at least 1.")


@dataclass(frozen=True)
class DDPGConfig(ActorConfig):
    """DDPG (Lillicrap et al. 2016) with an ensemble of critics and, optionally, a start from pi_B."""

    solves: ClassVar[bool] = False

    critics: Count = 2
    """Members of the critic ensemble; targets and actor use their mean."""
    critic_updates: Count = 10
    """Mini-batches the critic learns from in one update, to one of the actor."""
    critic_optimiser: Literal["adam", "rmsprop"] = "adam"
    critic_lr: NotNegative = (1e-3,)
    tau: Share = (0.05,)
    """Rate of the target networks' soft update."""
    member_targets: bool = False
    """Every critic learns from its own target network; off: all from the mean of the target networks."""
    prior_scale: Annotated[float, Range(0.0)] = 0.0
    """Weight of a fixed random network beside each critic (Osband et al. 2018), about the standard deviation of the
    values that it adds; 0: none."""


DDPG = DDPGConfig(noise=(0.15,))
"""DDPG from nothing, as tuned for itself."""

WARM_START = DDPGConfig(init="behaviour", actor_lr=(1e-4,))
"""DDPG that starts from pi_B, as tuned for itself: SRL without posterior, selection and guidance."""


@dataclass(frozen=True)
class SRLConfig(DDPGConfig):
    """Survivable robotic learning (Raza et al. 2021): the seven parts, each with its own switch."""

    init: Literal["random", "behaviour"] = "behaviour"
    values: Literal["action", "policy"] = "action"
    """What proposals are compared by: Q of the one action that each proposes, or the value of following from here on
    whoever proposes it, for which the critics have a head each (`agents.following`)."""
    select: bool = True
    """Selection between the student's and the teachers' actions; off: the student always acts."""
    selection: Literal["thompson", "greedy"] = "thompson"
    """thompson: by a draw of the posterior; greedy: by the mean critic, with no commitment (Hu et al. 2024)."""
    segment: Annotated[int, Range(0)] = 0
    """Control steps of an episode for which a choice is kept (20: a second); 0: every step chooses."""
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
    draws: Count = 12
    """Posterior samples per decision (a multiple of critics)."""
    guidance_draws: Count = 4
    """Posterior samples that weigh the guidance at every state of a mini-batch (a multiple of critics)."""
    guidance_weighting: Literal["posterior", "mean", "annealed"] = "posterior"
    """What weighs the guidance at a state: the posterior probability that the best teacher is better there than the
    student, whether the mean critic says so (the Q-filter of Nair et al. 2018), or nothing but time, falling linearly
    to 0 at guidance_decay (the first teacher's then)."""
    critic_loss: Literal["td", "alpha"] = "td"
    """td: squared error; alpha: AC-Teach's alpha-divergence over dropout samples."""
    dropout_update: bool = False
    """Fresh dropout masks in the critic's loss too; off: dropout only in the posterior's draws."""
    behaviour_target: bool = False
    """The TD target's next action is the better of target actor and teachers under the online critic."""
    dropout: Rate = (0.02,)
    """Dropout rate of the posterior."""
    beta: Share = (0.6,)
    """Posterior probability needed to switch; decays with psi per refusal."""
    psi: Share = (0.99,)
    guidance_weight: NotNegative = (10.0,)
    """Weight of the pull towards the best teacher in the actor's loss, where the posterior favours it; 0: off."""
    guidance_decay: Positive = (20_000.0,)
    """Environment steps until annealed guidance reaches 0."""
    prior_fraction: Share = (0.0,)
    """Fraction of the mini-batch from healthy transitions at the start; decays linearly to 0."""
    prior_decay: Positive = (20_000.0,)
    """Environment steps until prior_fraction reaches 0."""
    bootstrap: Share = (1.0,)
    """Probability that a transition is among the data of one ensemble member, for good; 1: every member sees all."""
    weight_decay: NotNegative = (0.0,)
    """Weight of the squared norm of the critic's parameters, the same for ever (AC-Teach's lambda)."""
    length_scale: NotNegative = (0.0,)
    """Length scale l of the prior of the critic's weights, N(0, 1 / l^2), that makes dropout variational by a weight
    decay that falls with the transitions seen (Gal & Ghahramani 2016; use it with dropout_update); 0: off."""
    alpha: Positive = (0.5,)
    """Order of the alpha-divergence (critic_loss=alpha)."""
    precision: Positive = (10.0,)
    """Observation precision tau of a TD target: of the alpha-divergence, and of the decay by length_scale."""

    def check(self, name: str) -> None:
        """Also raises ValueError where posterior draws do not fall evenly on the members, or targets contradict."""
        super().check(name)
        if self.values == "policy" and self.behaviour_target:
            raise ValueError(
                f"{name}.behaviour_target is True with {name}.values=policy, whose heads learn what it is worth to "
                "follow one policy each: leave one out."
            )
        for field in ("draws", "guidance_draws"):
            if (draws := getattr(self, field)) % self.critics:
                raise ValueError(f"{name}.{field} is {draws}: it must be a multiple of critics={self.critics}.")


@dataclass(frozen=True)
class FrozenConfig(AgentSettings):
    """A policy that does not learn."""

    solves: ClassVar[bool] = False

    policy: Literal["behaviour", "tripod"] = "behaviour"
    """pi_B, or the tuned tripod gait whatever pi_B is."""


@dataclass(frozen=True)
class SearchConfig(AgentSettings):
    """Episodic policy gradient over the gait's parameters (Ghavamzadeh & Engel 2006)."""

    first_teacher: ClassVar[str | None] = "gait"

    estimator: Literal["monte_carlo", "model1", "model2"] = "monte_carlo"
    """Monte-Carlo's gradient, or that of Bayesian quadrature."""
    trajectories: Annotated[int, Range(2)] = 20
    """Episodes in one estimate (M)."""
    search_rate: Positive = (1.0,)
    """Step along the natural gradient of standardised returns, in standard deviations of the search."""
    spread: Positive = (0.2,)
    """Standard deviation of the parameters at the start, in units of action (1: a joint's full excursion)."""
    spread_floor: Positive = (0.02,)
    """Standard deviation below which the search does not fall."""
    return_noise: Positive = (0.5,)
    """Variance of the observation noise on standardised returns (Bayesian quadrature only)."""


@dataclass(frozen=True)
class ITEConfig(AgentSettings):
    """Intelligent trial and error (Cully et al. 2015): map-based Bayesian optimisation after the damage."""

    tasks: ClassVar[tuple[str, ...] | None] = ("x", "xy")  # its gaits walk straight ahead
    episode_steps: ClassVar[int | None] = 100  # the map's fitness is the distance of 5 s
    one_damage: ClassVar[bool] = True  # what one trial tells, the next goes by

    repertoire: str = ""
    """The map, a file made by ``python -m srl_jax.repertoire``; empty: the one that ships with the package."""
    trials: Count = 20
    """Gaits that are tried at most, an episode each."""
    rho: Positive = (0.2,)
    """Length scale of the process over duty factors (0.4 as published: here one bad trial then spoils half the map)."""
    prior: Positive = (1.0,)
    """Prior variance of a gait's fitness about the map, m^2."""
    trial_noise: Positive = (1e-3,)
    """Variance of a trial about its gait's true fitness, m^2."""
    kappa: Positive = (0.05,)
    """Weight of the standard deviation in the choice of the next gait."""
    sufficient: Positive = (0.9,)
    """Share of the best expected fitness at which the search ends."""


@dataclass(frozen=True)
class BACConfig(ActorConfig):
    """Bayesian actor-critic (Ghavamzadeh & Engel 2007) with a Gaussian around a deterministic actor."""

    batch: Count = 64
    """Transitions in a mini-batch, all of which meet in one Gaussian process."""
    init: Literal["random", "behaviour"] = "behaviour"
    actor_lr: NotNegative = (3e-5,)
    noise: Positive = (0.25,)
    """Standard deviation of the Gaussian policy at the start; one without any has no score."""
    noise_floor: Positive = (0.05,)
    noise_correlation: Correlation = (0.0,)
    kernel_length: Positive = (10.0,)
    """Length scale of the critic's kernel of observations (whose components are of order one)."""
    value_scale: Positive = (100.0,)
    """Prior variance of the value of a state."""
    advantage_scale: Positive = (1.0,)
    """Prior variance of the advantage of an action."""
    reward_noise: Positive = (0.1,)
    """Variance of a temporal difference about the process."""
