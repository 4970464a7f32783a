"""What a run is: its task, its lanes' common clock, and the settings of every algorithm (see `agents.settings`).

This module imports no jax, so that ``--help`` answers at once.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Literal

from srl_jax.agents.settings import ACTEACH, BACConfig, DDPGConfig, FrozenConfig, ITEConfig, SearchConfig, SRLConfig

TASKS = ("x", "xy", "p2p")
ACTOR_CRITICS = ("ddpg", "srl", "ddpg_warm", "acteach")
ALGORITHMS = (*ACTOR_CRITICS, "bac", "mcpg", "bpg", "ite", "tripod", "pi_b")


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
class Config:
    """A run: what is trained, on what, and where its results go."""

    task: Literal["x", "xy", "p2p"] = "p2p"
    """x: distance along x; xy: distance in any direction; p2p: reach a point."""
    seeds: str = "10"
    """A count (seeds 0..N-1) or a list (3,7,11)."""
    algos: str = "ddpg,srl"
    """Any of ddpg, srl, ddpg_warm, acteach, bac, mcpg, bpg, ite, tripod, pi_b, separated by commas."""
    damage: str = "task"
    """task (the paper's, all six legs), all (the catalogue), losses21, or names such as tibia_rm,leg_rm+leg_lf."""
    damage_schedule: str = ""
    """Damage that changes in the middle of the run: healthy@0,tibia_rm@20000,leg_rm@40000 (replaces damage)."""
    steps: int = 50_000
    """Environment steps of each lane."""
    behaviour: str = "gait"
    """pi_B: gait (the tuned tripod), train (learn a healthy policy first, one per seed), repertoire (what trial and
    error finds after the damage), or a finished run; several, separated by commas, are several teachers."""
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
    bac: BACConfig = field(default_factory=BACConfig)
    mcpg: SearchConfig = field(default_factory=SearchConfig)
    bpg: SearchConfig = field(default_factory=lambda: SearchConfig(estimator="model2"))
    ite: ITEConfig = field(default_factory=ITEConfig)
    tripod: FrozenConfig = field(default_factory=lambda: FrozenConfig(policy="tripod"))
    pi_b: FrozenConfig = field(default_factory=FrozenConfig)


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
        agents = {algo: _paper(getattr(base, algo)) for algo in ACTOR_CRITICS}
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
            for algo in ACTOR_CRITICS
        }
        env = dataclasses.replace(base.env, episode_steps=40)
        agents["bac"] = dataclasses.replace(base.bac, hidden=(32, 32), batch=32, freeze=(400.0,))
        return dataclasses.replace(
            base, seeds="2", damage="leg_rm", algos="ddpg,srl", steps=1_600, env=env, train=train, **agents
        )
    if name != "default":
        raise ValueError(f"preset is {name!r}: choose default, paper or smoke.")
    return base
