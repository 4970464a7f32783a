"""Every setting, with its default and its reason to exist; validated before anything is allocated.

A field of type ``Sweep`` may hold several values: each value adds lanes, never another program. Everything else is
static and shapes the compiled program. This module imports no jax, so that ``--help`` answers at once.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Literal

from tyro.constructors import PrimitiveConstructorSpec

TASKS = ("x", "xy", "p2p")
ALGORITHMS = ("ddpg", "srl", "ddpg_warm", "acteach")


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
class EnvConfig:
    """The task around the robot. Lengths in metres, times in control steps of 1/20 s."""

    episode_steps: int = 100
    """Control steps until an episode is truncated."""
    reward: Literal["dense", "sparse"] = "dense"
    """dense: progress, effort, goal and fall terms; sparse: 1 on reaching the goal, else 0."""
    observation: Literal["full", "onboard"] = "full"
    """onboard: only what the real robot senses (joint angles, clock, gravity, goal direction)."""
    goal_ring: tuple[float, float] = (1.2, 1.6)
    """p2p: the goal is drawn uniformly in angle and radius from this ring about the start."""
    goal_radius: float = 0.15
    """p2p: distance to the goal that counts as reached."""
    sparse_distance: float = 1.0
    """x and xy under the sparse reward: the displacement that counts as the goal."""
    start_noise: float = 0.05
    """Half-width of the uniform noise on the joint angles at reset, rad."""
    progress_weight: float = 50.0
    """Reward per metre of progress (20 Hz: 0.4 m/s earns 1 a step)."""
    effort_weight: float = 0.05
    """Reward lost per unit of mean squared action."""
    goal_bonus: float = 5.0
    """Reward for reaching the goal of p2p."""
    fall_penalty: float = 1.0
    """Reward lost on tipping over, which ends the episode."""


@dataclass(frozen=True)
class TrainConfig:
    """How lanes collect and learn; one clock shared by all of them. Steps are environment steps of one lane."""

    environments: int = 10
    """Environments a lane steps at once."""
    capacity: int = 50_000
    """Transitions a lane's replay holds."""
    warmup: int = 1_000
    """Environment steps before the first update."""
    update_every: int = 2
    """Vector steps (of `environments` environment steps) between two updates of the agents."""
    evaluate_every: int = 5_000
    """Environment steps between two evaluations of the student alone."""
    checkpoint_every: int = 25_000
    """Environment steps between two checkpoints (a multiple of evaluate_every)."""
    prior_steps: int = 2_400
    """Healthy transitions of pi_B collected for cloning and for the prior replay."""
    clone_updates: int = 1_000
    """Gradient steps of behaviour cloning where the student starts from a scripted pi_B."""
    physics_block: int = 6
    """Lanes whose physics is stepped together on a CPU (cache-sized); 0: all at once, as on a GPU."""
    update_block: int = 4
    """Lanes that learn together on a CPU (cache-sized); 0: all at once, as on a GPU."""


@dataclass(frozen=True)
class DDPGConfig:
    """DDPG (Lillicrap et al. 2016) with an ensemble of critics and, optionally, a start from pi_B."""

    hidden: tuple[int, ...] = (64, 64)
    """Hidden widths of actor and critic."""
    layer_norm: bool = True
    """LayerNorm after each hidden layer."""
    critics: int = 2
    """Members of the critic ensemble; targets and actor use their mean."""
    batch: int = 128
    """Transitions in a mini-batch."""
    critic_updates: int = 2
    """Mini-batches the critic learns from in one update, to one of the actor."""
    critic_optimiser: Literal["adam", "rmsprop"] = "adam"
    actor_optimiser: Literal["adam", "rmsprop"] = "adam"
    init: Literal["random", "behaviour"] = "random"
    """behaviour: the actor starts from pi_B's parameters (from cloning where pi_B is scripted)."""
    actor_lr: Sweep = (3e-4,)
    critic_lr: Sweep = (1e-3,)
    gamma: Sweep = (0.97,)
    """Discount."""
    tau: Sweep = (0.05,)
    """Rate of the target networks' soft update."""
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
class Config:
    """A run: what is trained, on what, and where its results go."""

    task: Literal["x", "xy", "p2p"] = "p2p"
    """x: distance along x; xy: distance in any direction; p2p: reach a point."""
    seeds: str = "10"
    """A count (seeds 0..N-1) or a list (3,7,11)."""
    algos: str = "ddpg,srl"
    """Any of ddpg, srl, ddpg_warm, acteach, separated by commas."""
    damage: str = "task"
    """task (the paper's, all six legs), all (the catalogue), losses21, or names such as tibia_rm,leg_rm+leg_lf."""
    damage_schedule: str = ""
    """Damage that changes in the middle of the run: healthy@0,tibia_rm@20000,leg_rm@40000 (replaces damage)."""
    steps: int = 50_000
    """Environment steps of each lane."""
    behaviour: str = "gait"
    """pi_B: gait (the tuned tripod), train (learn a healthy policy first, one per seed), or a finished run."""
    devices: str = "auto"
    """Devices the lanes are laid over: auto (one per core, or all accelerators) or a number."""
    memory_gb: float = 16.0
    """The run refuses to start when its arithmetic exceeds this."""
    env: EnvConfig = field(default_factory=EnvConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    ddpg: DDPGConfig = field(default_factory=DDPGConfig)
    ddpg_warm: DDPGConfig = field(default_factory=lambda: DDPGConfig(init="behaviour"))
    acteach: SRLConfig = field(default_factory=lambda: ACTEACH)
    srl: SRLConfig = field(default_factory=SRLConfig)


def _paper(config: DDPGConfig) -> DDPGConfig:
    return dataclasses.replace(
        config,
        hidden=(1200, 1200, 1200, 1200, 600),
        critics=1,
        critic_updates=1,
        batch=300,
        actor_optimiser="rmsprop",
        actor_lr=(3e-2,),
        critic_lr=(3e-2,),
        noise=(1.0,),
        noise_decay=(0.9999,),
        noise_correlation=(0.0,),
    )


def preset(name: str) -> Config:
    """The named starting point: ``default`` (tuned for two cores), ``paper`` (its table as printed), ``smoke``."""
    base = Config()
    if name == "paper":
        agents = {algo: _paper(getattr(base, algo)) for algo in ALGORITHMS}
        agents["srl"] = dataclasses.replace(agents["srl"], dropout=(0.1,), dropout_update=True)
        env = dataclasses.replace(base.env, episode_steps=2500)
        train = TrainConfig(
            environments=1,
            capacity=1_600,
            update_every=1,
            evaluate_every=175_000,
            checkpoint_every=175_000,
            prior_steps=1_600,
        )
        return dataclasses.replace(base, steps=7000 * 2500, env=env, train=train, **agents)
    if name == "smoke":
        train = TrainConfig(
            capacity=1_600,
            warmup=160,
            evaluate_every=800,
            checkpoint_every=800,
            prior_steps=400,
            clone_updates=100,
        )
        agents = {
            algo: dataclasses.replace(getattr(base, algo), hidden=(32, 32), batch=32, freeze=(400.0,))
            for algo in ALGORITHMS
        }
        env = dataclasses.replace(base.env, episode_steps=40)
        return dataclasses.replace(
            base, seeds="2", damage="leg_rm", algos="ddpg,srl", steps=1_600, env=env, train=train, **agents
        )
    if name != "default":
        raise ValueError(f"preset is {name!r}: choose default, paper or smoke.")
    return base
