"""Jump-start RL (Uchendu et al. 2023): the first h control steps of an episode are pi_B's, the others the student's.

pi_B takes the robot to states from which little is left to learn, and h falls as the student learns: linearly with the
steps taken instead of with success, so that no lane waits for an evaluation. What is learned, and how, is SRL without
selection and guidance: DDPG, from all transitions.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.agents import noise, srl
from srl_jax.agents.ddpg import AgentState
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Teacher
from srl_jax.agents.rivals import JumpStartConfig
from srl_jax.agents.selection import proposals
from srl_jax.types import ActState


def horizon(hyper: Hyper, step: jax.Array) -> jax.Array:
    """Control steps f32[] of an episode that are pi_B's after so many environment steps f32[]."""
    return hyper.jump_steps * jnp.maximum(1.0 - step / hyper.jump_decay, 0.0)


def act(
    state: AgentState,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    config: JumpStartConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[jax.Array, ActState]:
    """pi_B's action or the student's, plus exploration noise; arguments and results as `srl.act`.

    Raises:
        ValueError: the age of the episode is not known, or there is no pi_B.
    """
    if act_state.age is None or not teachers:
        raise ValueError(f"age is {act_state.age} and there are {len(teachers)} teachers: both are needed.")
    choice = (act_state.age < horizon(hyper, step)).astype(jnp.int32)
    action = proposals(state.actor, observation, teachers[:1], config=config)[choice]
    act_state = act_state._replace(guidance=act_state.guidance._replace(choice=choice))
    return noise.explore(action, act_state, key, hyper=hyper, step=step)


def agent(config: JumpStartConfig) -> Agent:
    """Jump-start RL as the program knows it."""
    return dataclasses.replace(srl.agent(config), act=partial(act, config=config), timed=True)
