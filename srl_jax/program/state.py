"""What the compiled program is made of and works on: its static parts, its rows, its state and its sums."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P
from jax.tree_util import Partial

from srl_jax.agents import ddpg, registry
from srl_jax.agents.hyper import Hyper
from srl_jax.bayes import controller
from srl_jax.config import Config
from srl_jax.env import gait as gaits
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import ACTION_SIZE, EnvState, Hexapod
from srl_jax.env.task import RewardTerms
from srl_jax.program.lanes import Layout
from srl_jax.program.replay import Replay
from srl_jax.types import ActState, Params

AXIS = "lanes"


class Mode(NamedTuple):
    """Who acts and what comes of it; scalars, so that training, evaluation and collection are one program."""

    actor: jax.Array  # i32[] 0 the algorithm, noise included; 1 the student alone; 2 pi_B alone
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


class LaneData(NamedTuple):
    """What distinguishes the rows and does not change while a chunk runs. R rows in all, n of one algorithm."""

    key: jax.Array  # key[R] stream of the lane's randomness
    damage: Damage  # leaves [R, ...]
    hyper: dict[str, Hyper]  # leaves [n]
    teachers: tuple[Params, ...]  # parameters of each teacher, leaves [R, ...]
    prior: dict[str, jax.Array]  # f32[n, P, W] healthy transitions, for algorithms that replay them


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


class TrainState(NamedTuple):
    """Everything that training changes."""

    clock: jax.Array  # i32[] environment steps taken by every lane
    agents: dict[str, Any]  # leaves [n, ...]
    replay: Replay  # rows f32[R, C, W]
    world: World
    alive: jax.Array  # bool[R] False once a lane has met a number that is not finite; it is frozen then


class Tally(NamedTuple):
    """Sums over a chunk; a mean is a sum over its count."""

    episodes: jax.Array  # f32[R]
    totals: dict[str, jax.Array]  # f32[R] summed over finished episodes: return, distance, success, fell
    steps: jax.Array  # f32[R]
    rates: dict[str, jax.Array]  # f32[R] summed over environment steps: who was chosen, reward terms
    updates: jax.Array  # f32[]
    losses: dict[str, dict[str, jax.Array]]  # f32[n] summed over updates, per algorithm


@dataclasses.dataclass(frozen=True)
class Program:
    """The static parts that `chunk` is compiled from."""

    config: Config
    layout: Layout
    robot: Hexapod
    teachers: tuple[Callable[[Params, jax.Array], jax.Array], ...]  # (params, observation) -> action
    mesh: Mesh
    wide: bool  # an accelerator: no blocks

    def agent_config(self, algo: str) -> Any:
        return getattr(self.config, algo)

    @property
    def environments(self) -> int:
        return self.config.train.environments


def bind_teachers(program: Program, algo: str, params: tuple[Params, ...]) -> tuple[ddpg.Teacher, ...]:
    """The teachers of an algorithm's lane, each a function of the observation and a pytree of its parameters."""
    if getattr(program.agent_config(algo), "policy", "behaviour") == "tripod":
        return (Partial(gaits.act, gaits.load()),)
    return tuple(Partial(teacher, p) for teacher, p in zip(program.teachers, params, strict=True))


def student(program: Program, algo: str, actor: Params, params: tuple[Params, ...]) -> Partial:
    """The policy f32[O] -> f32[18] that an algorithm has learned, from one lane's actor and teachers' parameters."""
    config = program.agent_config(algo)

    def policy(actor: Params, params: tuple[Params, ...], observation: jax.Array) -> jax.Array:
        teachers = bind_teachers(program, algo, params)
        return registry.module(config).student(actor, observation, config=config, teachers=teachers)

    return Partial(policy, actor, params)


def sharding(program: Program) -> NamedSharding:
    """Rows laid over the program's devices."""
    return NamedSharding(program.mesh, P(AXIS))


def fresh_act_state(key: jax.Array) -> ActState:
    """No noise, the student in command, a new seed: the state of acting at the start of an episode."""
    return ActState(noise=jnp.zeros(ACTION_SIZE), guidance=controller.init(), seed=jax.random.bits(key))


def zero_tally(program: Program, zeros: Any, rows: dict[str, int]) -> Tally:
    """A tally of nothing yet.

    Args:
        program: static parts.
        zeros: f32[R], one zero per row.
        rows: how many of them each algorithm has.
    """
    terms = [f"reward_{name}" for name in RewardTerms._fields]
    losses = {
        algo: {name: zeros[:count] for name in registry.module(program.agent_config(algo)).METRICS}
        for algo, count in rows.items()
    }
    chosen = [f"chosen_{index}" for index in range(1, 1 + len(program.teachers))]
    return Tally(
        episodes=zeros,
        totals={name: zeros for name in ("return", "distance", "success", "fell")},
        steps=zeros,
        rates={name: zeros for name in ("chosen_teacher", *(chosen if len(chosen) > 1 else []), *terms)},
        updates=zeros[0],
        losses=losses,
    )
