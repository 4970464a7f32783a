"""A policy that does not learn, as an agent like any other: what every learner is measured against."""

from collections.abc import Sequence
from typing import NamedTuple

import jax

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Teacher
from srl_jax.agents.settings import FrozenConfig
from srl_jax.types import ActState, Params


class FrozenState(NamedTuple):
    """Nothing: the policy is the first teacher."""

    actor: tuple = ()
    critic: tuple = ()


def init(key: jax.Array, observation_size: int, action_size: int, *, teachers: Sequence[Teacher] = ()) -> FrozenState:
    """The empty state; arguments as `ddpg.init`."""
    del key, observation_size, action_size, teachers
    return FrozenState()


def student(actor: Params, observation: jax.Array, *, teachers: Sequence[Teacher] = ()) -> jax.Array:
    """The first teacher's action f32[A]."""
    del actor
    return teachers[0](observation)


def act(
    state: FrozenState,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[jax.Array, ActState]:
    """The policy's action without noise; arguments and results as `ddpg.act`."""
    del key, hyper, step
    return student(state.actor, observation, teachers=teachers), act_state


def agent(config: FrozenConfig) -> Agent:
    """A frozen policy as the program knows it."""
    return Agent(init=init, act=act, student=student, own_gait=config.policy == "tripod")
