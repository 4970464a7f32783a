"""The acting half of the compiled program: robots at the start of an episode, and every robot's action."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from srl_jax.agents import noise
from srl_jax.agents.hyper import Hyper
from srl_jax.bayes import controller
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState
from srl_jax.program import mix, strides
from srl_jax.program.randomness import Stream, at_step
from srl_jax.program.state import Episode, LaneData, Mode, Program, TrainState, World, bind_teachers, tuned_gait
from srl_jax.types import ActState

START_ACT = 1  # of a robot's key: what acting draws at the start of an episode


def init_world(program: Program, keys: jax.Array, damage: Damage, starts: EnvState | None) -> World:
    """Fresh robots at the start of an episode, R rows of E, from the robots' keys key[R, E]; each draws of a mix."""

    def robot(key: jax.Array, damage_: Damage, starts_: EnvState | None):
        number = mix.draw(len(program.mix), key) if program.mix else None
        if number is not None:
            damage_, starts_ = mix.taken((damage_, starts_), number)
        env, observation = hexapod.reset(program.robot, damage_, key)
        if starts_ is not None:
            env = strides.begin(program.robot, starts_, env, key)
            observation = hexapod.observe(program.robot, damage_, env)
        return env, observation, fresh_act_state(jax.random.fold_in(key, START_ACT), program.action_size), number

    lanes = jax.vmap(jax.vmap(robot, (0, None, None)))
    env, observation, act, number = lanes(keys, damage, starts)
    zeros = jnp.zeros(keys.shape)
    return World(env, act, observation, Episode(zeros, jnp.copy(zeros), jnp.copy(zeros)), number)


def fresh_act_state(key: jax.Array, action_size: int) -> ActState:
    """Stationary noise, the student in command, a new seed: the state of acting at the start of an episode."""
    return ActState(
        noise=noise.start(jax.random.fold_in(key, 1), action_size),
        guidance=controller.init(),
        seed=jax.random.bits(key),
    )


def act_rows(program: Program, lanes: LaneData, mode: Mode, state: TrainState) -> tuple[jax.Array, ActState]:
    """Every robot's action f32[R, E, J]: its algorithm's, its student's, pi_B's or its own gait's, as the mode says."""
    keys = at_step(lanes.key, state.clock, Stream.ACT)
    told = state.world.act._replace(age=state.world.env.steps)
    actions, act_states = [], []
    for algo, own in program.layout.slices().items():
        lane = partial(act_lane, program, algo, mode, state.clock)
        seen = told if program.agents[algo].timed else state.world.act
        rows = (seen, state.world.observation, keys, lanes.teachers)
        mine = jax.tree.map(lambda x, own=own: x[own], rows)
        action, act_state = jax.vmap(lane)(state.agents[algo], mine, lanes.hyper[algo])
        actions.append(action)
        act_states.append(act_state._replace(age=None))  # which the robot's clock has
    return jnp.concatenate(actions), jax.tree.map(lambda *x: jnp.concatenate(x), *act_states)


def act_lane(program: Program, algo: str, mode: Mode, clock: jax.Array, agent: Any, rows: tuple, hyper: Hyper):
    """The actions f32[E, J] of one lane's robots."""
    act_states, observations, key, teacher_params = rows
    functions, teachers = program.agents[algo], bind_teachers(program, algo, teacher_params)

    def own(act_state: ActState, observation: jax.Array, key_: jax.Array):
        step = clock.astype(jnp.float32)
        return functions.act(agent, act_state, observation, key_, hyper=hyper, step=step, teachers=teachers)

    def alone(act_state: ActState, observation: jax.Array, key_: jax.Array):
        del key_
        return functions.student(agent.actor, observation, teachers=teachers), act_state

    def advised(act_state: ActState, observation: jax.Array, key_: jax.Array):
        _, new_state = own(act_state, observation, key_)  # whose exploration noise is what is added
        return jnp.clip(teachers[0](observation) + mode.noise * new_state.noise, -1.0, 1.0), new_state

    def reference(act_state: ActState, observation: jax.Array, key_: jax.Array):
        del key_
        return tuned_gait(program.robot.anatomy)(observation), act_state

    def one(*args):
        return jax.lax.switch(mode.actor, (own, alone, advised, reference), *args)

    return jax.vmap(one)(act_states, observations, jax.random.split(key, program.environments))
