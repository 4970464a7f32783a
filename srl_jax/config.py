"""What a run is: its task, its lanes' common clock, and the settings of every algorithm.

Composed of the sections that `env`, `program` and `agents` own. This module imports no jax, so that ``--help`` answers
at once.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import tyro

from srl_jax.agents import registry
from srl_jax.agents.rivals import JumpStartConfig
from srl_jax.agents.settings import BACConfig, DDPGConfig, FrozenConfig, ITEConfig, SearchConfig, SRLConfig
from srl_jax.agents.sweep import AgentSettings
from srl_jax.env import damage_names
from srl_jax.env.anatomy import PHANTOMX, Anatomy, named
from srl_jax.env.settings import EnvConfig
from srl_jax.program.settings import EvaluationConfig, TrainConfig

ACTOR_CRITICS = ("ddpg", "srl", "ddpg_warm", "acteach", "rlpd", "ibrl", "jsrl")
Preset = Literal["default", "paper", "robot", "smoke"]


_SHIPPED: Any = registry.SHIPPED


STRIDE_STARTS = 0.5  # share of episodes, where policies learn to take over in mid-stride
GUIDANCE_WEIGHT = 1.0  # of the teacher of such policies


@dataclass(frozen=True)
class Config:
    """A run: what is trained, on what, and where its results go."""

    task: Literal["x", "xy", "p2p"] = "p2p"
    """x: distance along x; xy: distance in any direction; p2p: reach a point."""
    robot: str = PHANTOMX.name
    """Who walks: phantomx (six legs), quadruped, or one that is registered."""
    seeds: str = "10"
    """A count (seeds 0..N-1) or a list (3,7,11)."""
    algos: str = "ddpg,srl"
    """Any of ddpg, srl, ddpg_warm, acteach, rlpd, ibrl, jsrl, bac, mcpg, bpg, ite, tripod, pi_b and what else is
    registered, separated by commas."""
    damage: str = "task"
    """Names such as tibia_rm,leg_rm+leg_lf and sets: task (the paper's, every leg in turn), all (the catalogue), losses
    (every joint), losses21 (one or two legs; losses10 of the quadruped), joints, limp (legs), triples (three legs
    lost), healthy; sets may be joined: losses21+limp."""
    damage_schedule: str = ""
    """Damage that changes in the middle of the run: healthy@0,tibia_rm@20000,leg_rm@40000 (replaces damage)."""
    damage_mix: str = ""
    """Damages of the robots of one lane, each with its own, drawn anew whenever it starts: names and sets as of damage,
    such as losses21+joints+healthy (replaces damage)."""
    steps: int = 50_000
    """Environment steps of each lane."""
    behaviour: str = "gait"
    """pi_B: gait (the scripted one), train (learn a healthy policy first, one per seed), repertoire (what trial and
    error finds after the damage), atlas (the best policy of an atlas for the damage), atlas-others (the best that was
    trained for another damage; either with :FILE), or a finished run; several, separated by commas, are several
    teachers."""
    devices: str = "auto"
    """Devices the lanes are laid over: auto (one per core, or all accelerators) or a number."""
    part: str = ""
    """k/n: only the k-th of n parts of the lanes, as a sweep's packs are; each has its share of every algorithm."""
    memory_gb: float = 16.0
    """Lanes are trained in several waves, one after the other, where the arithmetic of all of them exceeds this."""
    env: EnvConfig = field(default_factory=EnvConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    ddpg: DDPGConfig = _SHIPPED["ddpg"]
    ddpg_warm: DDPGConfig = _SHIPPED["ddpg_warm"]
    acteach: SRLConfig = _SHIPPED["acteach"]
    rlpd: SRLConfig = _SHIPPED["rlpd"]
    ibrl: SRLConfig = _SHIPPED["ibrl"]
    jsrl: JumpStartConfig = _SHIPPED["jsrl"]
    srl: SRLConfig = _SHIPPED["srl"]
    bac: BACConfig = _SHIPPED["bac"]
    mcpg: SearchConfig = _SHIPPED["mcpg"]
    bpg: SearchConfig = _SHIPPED["bpg"]
    ite: ITEConfig = _SHIPPED["ite"]
    tripod: FrozenConfig = _SHIPPED["tripod"]
    pi_b: FrozenConfig = _SHIPPED["pi_b"]
    more: Annotated[Mapping[str, AgentSettings], tyro.conf.Suppress] = field(default_factory=dict)
    """Settings of algorithms that others have registered, by name."""

    def agent(self, name: str) -> AgentSettings:
        """The settings of an algorithm.

        Raises:
            ValueError: there is none of that name.
        """
        if name in registry.SHIPPED:
            return getattr(self, name)
        return self.more[name] if name in self.more else registry.settings(name)

    @property
    def anatomy(self) -> Anatomy:
        """The robot's description.

        Raises:
            ValueError: there is none of its name.
        """
        return named(self.robot)

    @property
    def solves(self) -> bool:
        """Whether its program may solve linear systems, as far as its settings tell: MJX does, and some algorithms."""
        algos = [self.agent(name.strip()) for name in self.algos.split(",")]
        searched = "repertoire" in self.behaviour  # the teacher is what `ite` finds
        return self.env.physics == "mjx" or searched or any(algo.solves for algo in algos)

    def with_agents(self, **settings: AgentSettings) -> "Config":
        """The same run with other settings of some algorithms."""
        shipped = {name: value for name, value in settings.items() if name in registry.SHIPPED}
        others = {name: value for name, value in settings.items() if name not in registry.SHIPPED}
        return dataclasses.replace(self, **shipped, more={**self.more, **others})


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


def taking_over(
    base: Config,
    task: str,
    observation: str,
    stride_starts: float = STRIDE_STARTS,
    guidance_weight: float = GUIDANCE_WEIGHT,
) -> Config:
    """SRL by what a robot senses, from where its damage has just struck: how policies for the atlas are learned."""
    env = dataclasses.replace(base.env, observation=observation, stride_starts=stride_starts)
    srl = dataclasses.replace(base.srl, guidance_weight=(guidance_weight,))
    return dataclasses.replace(base, task=task, algos="srl", env=env, srl=srl)


def _robot(base: Config) -> Config:
    """Eight minutes of one robot at 20 Hz, from the best policy of an atlas that does not know its damage."""
    env = dataclasses.replace(base.env, observation="onboard", stride_starts=STRIDE_STARTS)
    train = dataclasses.replace(
        base.train,
        environments=1,
        update_every=1,
        warmup=200,
        capacity=10_000,
        evaluate_every=1_200,
        checkpoint_every=9_600,
    )
    lone = dict(critic_updates=2, freeze=(400.0,), noise=(0.1,))
    return dataclasses.replace(
        base,
        task="x",
        algos="srl,ddpg_warm",
        steps=9_600,
        behaviour="atlas-others",
        env=env,
        train=train,
        srl=dataclasses.replace(base.srl, **lone),
        ddpg_warm=dataclasses.replace(base.ddpg_warm, **lone),
    )


def preset(name: str, robot: str = PHANTOMX.name) -> Config:
    """The named starting point: ``default`` (tuned for two cores), ``paper`` (its table as printed), ``smoke``, and
    ``robot``, as one robot would learn after its damage: one environment, what it senses, an update a step.

    Args:
        name: of the preset.
        robot: whose parts its damage is of.

    Raises:
        ValueError: there is no such preset or robot.
    """
    base = Config(robot=robot)
    if name == "robot":
        return _robot(base)
    if name == "paper":
        agents = {algo: _paper(getattr(base, algo)) for algo in ACTOR_CRITICS}
        agents["srl"] = dataclasses.replace(agents["srl"], dropout=(0.1,), dropout_update=True, length_scale=(1.0,))
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
        damage = damage_names.lost(1, base.anatomy)[1]
        return dataclasses.replace(
            base, seeds="2", damage=damage, algos="ddpg,srl", steps=1_600, env=env, train=train, **agents
        )
    if name != "default":
        raise ValueError(f"preset is {name!r}: choose default, paper, robot or smoke.")
    return base
