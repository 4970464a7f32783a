"""The one compiled program: every lane's robots act, are simulated, remember and learn in one jitted `chunk`."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import PartitionSpec as P

from srl_jax.agents import registry
from srl_jax.agents.hyper import Hyper
from srl_jax.blocks import blocked_map
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, EnvStep
from srl_jax.program import replay as replays
from srl_jax.program.learn import learn_episodes, learn_rows
from srl_jax.program.state import (
    AXIS,
    Episode,
    LaneData,
    Mode,
    Program,
    Tally,
    TrainState,
    World,
    bind_teachers,
    fresh_act_state,
    zero_tally,
)
from srl_jax.types import ActState, EndedEpisodes, Transition


def init_world(program: Program, keys: jax.Array, damage: Damage) -> World:
    """Fresh robots at the start of an episode, R rows of E, from the rows' keys."""
    count = program.environments

    def lane(key: jax.Array, damage_: Damage):
        keys_ = jax.random.split(key, count)
        robots = jax.vmap(lambda k: hexapod.reset(program.robot, damage_, k))(keys_)
        return *robots, jax.vmap(lambda k: fresh_act_state(jax.random.fold_in(k, 1)))(keys_)

    env, observation, act = jax.vmap(lane)(keys, damage)
    zeros = jnp.zeros(observation.shape[:2])
    return World(env, act, observation, Episode(zeros, jnp.copy(zeros), jnp.copy(zeros)))


def make_chunk(
    program: Program,
) -> Callable[[TrainState, LaneData, Mode, jax.Array], tuple[TrainState, Tally]]:
    """The jitted ``chunk(state, lanes, mode, n) -> (state, tally)``: n vector steps of every lane.

    `mode` and `n` are values, so one compilation serves training, evaluation, frozen pi_B and collection. `state` is
    donated. Rows never exchange anything: `shard_map` gives each device its own without collectives.
    """

    def local(state: TrainState, lanes: LaneData, mode_: Mode, n: jax.Array):
        carry = state, zero_tally(program, jnp.zeros(state.alive.shape), dict(program.layout.counts))
        return jax.lax.fori_loop(0, n, lambda _, c: vector_step(program, lanes, mode_, *c), carry)

    rows, same = P(AXIS), P()
    state_spec = TrainState(clock=same, agents=rows, replay=rows, world=rows, alive=rows)  # type: ignore[arg-type]
    tally_spec = Tally(rows, rows, rows, rows, same, rows)  # type: ignore[arg-type]
    mapped = jax.shard_map(
        local,
        mesh=program.mesh,
        in_specs=(state_spec, rows, same, same),
        out_specs=(state_spec, tally_spec),
        check_vma=False,
    )
    return jax.jit(mapped, donate_argnums=0)


def vector_step(
    program: Program, lanes: LaneData, mode_: Mode, state: TrainState, tally: Tally
) -> tuple[TrainState, Tally]:
    """One control step of every robot on this device, and what is learned from it."""
    keys = jax.vmap(lambda k: jax.random.split(jax.random.fold_in(k, state.clock), 3))(lanes.key)
    action, act_state = act_rows(program, lanes, mode_, state, keys[:, 0])
    env, step = simulate_rows(program, lanes.damage, state.world.env, action)

    finite = jnp.isfinite(step.observation).all((1, 2)) & jnp.isfinite(step.reward).all(1)
    alive = state.alive & finite
    transition = Transition(
        observation=state.world.observation,
        action=action,
        reward=step.reward,
        discount=1.0 - step.terminated.astype(jnp.float32),
        next_observation=step.observation,
        chosen=act_state.guidance.choice.astype(jnp.float32),
    )
    memory = replays.add(state.replay, transition, state.clock, mode_.store & alive)
    episodes = ended_episodes(program, state, act_state, env, step, alive & mode_.learn)
    agents = learn_episodes(program, lanes, state.agents, episodes)
    tally, episode = count_step(tally, state.world.episode, act_state, step, alive, first_only=~mode_.store)
    world = auto_reset(
        program, lanes, state.world, World(env, act_state, step.observation, episode), step, keys[:, 1], alive
    )

    clock = state.clock + program.environments
    state = TrainState(clock, agents, memory, world, alive)
    train = program.config.train
    turn = (clock // program.environments) % train.update_every == 0
    due = mode_.learn & (clock >= train.warmup) & turn
    return jax.lax.cond(due, partial(learn_rows, program, lanes), lambda s, t, _: (s, t), state, tally, keys[:, 2])


def act_rows(
    program: Program, lanes: LaneData, mode_: Mode, state: TrainState, keys: jax.Array
) -> tuple[jax.Array, ActState]:
    """Every robot's action f32[R, E, 18]: its algorithm's, its student's, or pi_B's, as the mode says."""
    actions, act_states = [], []
    for algo, rows in program.layout.slices().items():
        lane = partial(act_lane, program, algo, mode_, state.clock)
        args = (
            state.agents[algo],
            jax.tree.map(
                lambda x, rows=rows: x[rows], (state.world.act, state.world.observation, keys, lanes.teachers)
            ),
            lanes.hyper[algo],
        )
        action, act_state = jax.vmap(lane)(*args)
        actions.append(action)
        act_states.append(act_state)
    return jnp.concatenate(actions), jax.tree.map(lambda *x: jnp.concatenate(x), *act_states)


def act_lane(program: Program, algo: str, mode_: Mode, clock: jax.Array, agent: Any, rows: tuple, hyper: Hyper):
    """The actions f32[E, 18] of one lane's robots."""
    act_states, observations, key, teacher_params = rows
    config = program.agent_config(algo)
    teachers = bind_teachers(program, algo, teacher_params)
    agents = registry.module(config)

    def own(act_state: ActState, observation: jax.Array, key_: jax.Array):
        settings = {"config": config, "hyper": hyper, "step": clock.astype(jnp.float32), "teachers": teachers}
        return agents.act(agent, act_state, observation, key_, **settings)

    def alone(act_state: ActState, observation: jax.Array, key_: jax.Array):
        del key_
        return agents.student(agent.actor, observation, config=config, teachers=teachers), act_state

    def advised(act_state: ActState, observation: jax.Array, key_: jax.Array):
        _, new_state = own(act_state, observation, key_)  # whose exploration noise is what is added
        return jnp.clip(teachers[0](observation) + mode_.noise * new_state.noise, -1.0, 1.0), new_state

    def one(*args):
        return jax.lax.switch(mode_.actor, (own, alone, advised), *args)

    return jax.vmap(one)(act_states, observations, jax.random.split(key, program.environments))


def simulate_rows(program: Program, damage: Damage, env: EnvState, action: jax.Array) -> tuple[EnvState, EnvStep]:
    """One control step of all robots, in blocks that fit the cache; physics is traced here and only here."""
    count = program.environments
    block = 0 if program.wide else program.config.train.physics_block * count
    # One flat axis of robots: with lanes and robots as two axes, MJX's small products are a sixth slower.
    rows = (jax.tree.map(lambda x: jnp.repeat(x, count, axis=0), damage), *_flat((env, action)))
    flat = blocked_map(lambda args: jax.vmap(partial(hexapod.step, program.robot))(*args), rows, block)
    return jax.tree.map(lambda x: x.reshape(-1, count, *x.shape[1:]), flat)


def _flat(rows):
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), rows)


def ended_episodes(
    program: Program, state: TrainState, act_state: ActState, env: EnvState, step: EnvStep, learning: jax.Array
) -> EndedEpisodes:
    """The episodes that this step has ended, leaves [R, E]; none of them in rows that are not `learning` bool[R]."""
    now = state.clock // program.environments + 1
    running = state.world.episode
    assert act_state.seed is not None
    return EndedEpisodes(
        ended=(step.terminated | step.truncated) & learning[:, None],
        seed=act_state.seed,
        returns=running.reward + step.reward,
        distance=running.progress + step.progress,
        began=now - env.steps,
        now=jnp.full_like(env.steps, now),
    )


def count_step(
    tally: Tally,
    episode: Episode,
    act_state: ActState,
    step: EnvStep,
    alive: jax.Array,
    *,
    first_only: jax.Array,
) -> tuple[Tally, Episode]:
    """Adds one vector step to the running episodes and, of those that end, to the tally.

    An evaluation counts the first episode of each robot only: short ones would otherwise count more often.
    """
    weight = alive.astype(jnp.float32)
    done = (step.terminated | step.truncated).astype(jnp.float32) * weight[:, None]
    counted = done * (~first_only | (episode.finished == 0.0))
    reward, progress = episode.reward + step.reward, episode.progress + step.progress
    ended = {"return": reward, "distance": progress, "success": step.success, "fell": step.fell}
    choice = act_state.guidance.choice
    rates = {"chosen_teacher": choice > 0}
    rates |= {name: choice == int(name.removeprefix("chosen_")) for name in tally.rates if name[7:].isdigit()}
    rates |= {f"reward_{name}": value for name, value in step.terms._asdict().items()}
    tally = tally._replace(
        episodes=tally.episodes + counted.sum(1),
        totals={name: tally.totals[name] + (counted * value).sum(1) for name, value in ended.items()},
        steps=tally.steps + weight * done.shape[1],
        rates={name: tally.rates[name] + weight * value.astype(jnp.float32).sum(1) for name, value in rates.items()},
    )
    going = 1.0 - done
    return tally, Episode(reward * going, progress * going, episode.finished + done)


def auto_reset(
    program: Program,
    lanes: LaneData,
    before: World,
    after: World,
    step: EnvStep,
    keys: jax.Array,
    alive: jax.Array,
) -> World:
    """Starts a new episode where one has ended; the robots of a frozen lane stay where they were."""
    fresh = init_world(program, keys, lanes.damage)
    done = step.terminated | step.truncated
    fresh = fresh._replace(episode=after.episode)

    def pick(old: jax.Array, new: jax.Array, start: jax.Array) -> jax.Array:
        extra = (1,) * (new.ndim - 2)
        new = jnp.where(done.reshape(*done.shape, *extra), start, new)
        return jnp.where(alive.reshape(-1, 1, *extra), new, old)

    return jax.tree.map(pick, before, after, fresh)
