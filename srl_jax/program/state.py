"""What the compiled program is made of and works on: its static parts, its rows and its state."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jax.tree_util import Partial

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Teacher
from srl_jax.env import gait as gaits
from srl_jax.env import hexapod
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, Hexapod
from srl_jax.program.lanes import Layout
from srl_jax.program.replay import Replay, Sizes
from srl_jax.program.settings import TrainConfig
from srl_jax.types import ActState, Params, Transition

AXIS = "lanes"


class Mode(NamedTuple):
    """Who acts and what comes of it; scalars, so that training, evaluation and collection are one program."""

    actor: jax.Array  # i32[] 0 the algorithm, noise included; 1 the student alone; 2 pi_B alone; 3 the tuned gait
    noise: jax.Array  # f32[] standard deviation of noise on pi_B's actions (actor 2)
    store: jax.Array  # bool[] whether transitions enter the replay
    learn: jax.Array  # bool[] whether agents update


def mode(actor: int, noise: float = 0.0, store: bool = False, learn: bool = False) -> Mode:
    """A `Mode` from plain values."""
    return Mode(jnp.int32(actor), jnp.float32(noise), jnp.bool_(store), jnp.bool_(learn))


TRAIN = partial(mode, 0, store=True, learn=True)
STUDENT = partial(mode, 1)
TEACHER = partial(mode, 2)
COLLECT = partial(mode, 2, store=True)
REFERENCE = partial(mode, 3)


class LaneData(NamedTuple):
    """What distinguishes the rows and does not change while a chunk runs. R rows in all, n of one algorithm."""

    key: jax.Array  # key[R] stream of the lane's randomness
    damage: Damage  # leaves [R, ...]; of a mix of M damages [R, M, ...]
    hyper: dict[str, Hyper]  # leaves [n]
    teachers: tuple[Params, ...]  # parameters of each teacher, leaves [R, ...]
    prior: dict[str, Transition]  # leaves [n, P, ...]: healthy transitions, for algorithms that replay them
    starts: EnvState | None = None  # leaves [R, S, ...] or [R, M, S, ...]: robots in mid-stride, as some episodes start


class Episode(NamedTuple):
    """Sums over the running episode of each environment, and how many episodes it has finished."""

    reward: jax.Array
    progress: jax.Array
    finished: jax.Array


class World(NamedTuple):
    """Robots in the middle of their episodes."""

    env: EnvState  # leaves [R, E, ...]
    act: ActState  # leaves [R, E, ...]
    observation: jax.Array  # f32[R, E, O]
    episode: Episode  # leaves [R, E]
    drawn: jax.Array | None = None  # i32[R, E] which damage of their lane's mix they carry; None: there is one


class TrainState(NamedTuple):
    """Everything that training changes."""

    clock: jax.Array  # i32[] environment steps taken by every lane
    agents: dict[str, Any]  # leaves [n, ...]
    replay: dict[str, Replay]  # leaves [n, ...], of the algorithms that replay
    world: World
    alive: jax.Array  # bool[R] False once a lane has met a number that is not finite; it is frozen then


@dataclasses.dataclass(frozen=True)
class Program:
    """The static parts that `chunk` is compiled from."""

    agents: dict[str, Agent]  # of every algorithm of the layout
    layout: Layout
    robot: Hexapod
    teachers: tuple[Callable[[Params, jax.Array], jax.Array], ...]  # (params, observation) -> action
    settings: TrainConfig
    mesh: Mesh
    wide: bool  # an accelerator: no blocks
    mix: tuple[str, ...] = ()  # M damages that every lane's robots draw from; none: a lane has one damage

    @property
    def environments(self) -> int:
        return self.settings.environments

    @property
    def observation_size(self) -> int:
        return hexapod.observation_size(self.robot.task, self.robot.config, self.robot.anatomy)

    @property
    def action_size(self) -> int:
        return self.robot.anatomy.action_size

    @property
    def sizes(self) -> Sizes:
        """Of what the replays hold."""
        return Sizes(self.observation_size, self.action_size, self.robot.config.episode_steps)


def bind_teachers(program: Program, algo: str, params: tuple[Params, ...]) -> tuple[Teacher, ...]:
    """The teachers of an algorithm's lane, each a function of the observation and a pytree of its parameters."""
    return _bound(program.agents[algo], program.robot.anatomy, program.teachers, params)


def _bound(
    agent: Agent, anatomy: Anatomy, teachers: tuple[Callable, ...], params: tuple[Params, ...]
) -> tuple[Teacher, ...]:
    if agent.own_gait:
        return (tuned_gait(anatomy),)
    return tuple(Partial(teacher, p) for teacher, p in zip(teachers, params, strict=True))


def tuned_gait(anatomy: Anatomy = PHANTOMX) -> Partial:
    """A robot's scripted gait: the reference that all methods share, whatever pi_B is."""
    return Partial(gaits.walker(anatomy), gaits.load(anatomy))


@dataclasses.dataclass(frozen=True)
class Student:
    """The policy that an algorithm has learned, of one lane's actor, its teachers' parameters and an observation.

    A class, since two of one algorithm are equal: what jax has compiled for one lane serves all.
    """

    agent: Agent
    anatomy: Anatomy
    teachers: tuple[Callable[[Params, jax.Array], jax.Array], ...]

    def __call__(self, actor: Params, params: tuple[Params, ...], observation: jax.Array) -> jax.Array:
        return self.agent.student(actor, observation, teachers=_bound(self.agent, self.anatomy, self.teachers, params))


def student(program: Program, algo: str, actor: Params, params: tuple[Params, ...]) -> Partial:
    """The policy f32[O] -> f32[J] that an algorithm has learned, from one lane's actor and teachers' parameters."""
    return Partial(Student(program.agents[algo], program.robot.anatomy, program.teachers), actor, params)


def rows_sharding(program: Program) -> NamedSharding:
    """Rows laid over the program's devices."""
    return NamedSharding(program.mesh, PartitionSpec(AXIS))


def on_rows(program: Program, rows: Any) -> Any:
    """Puts a pytree of host arrays with a leading row axis onto the program's devices."""
    return jax.device_put(rows, rows_sharding(program))


def on_all(program: Program, value: Any) -> Any:
    """Puts what all rows share onto every one of the program's devices."""
    return jax.device_put(value, NamedSharding(program.mesh, PartitionSpec()))
