"""Intelligent trial and error (Cully et al. 2015) as an agent like any other: a trial is an episode.

The robot, the lane's first environment, walks an episode by one gait of a map that was made before the damage; what it
reached decides the next gait, until one is good enough. The lane's other environments walk along and teach nothing, so
that a trial costs one robot one episode. The student is the best gait that was tried.
"""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.settings import ITEConfig
from srl_jax.env import gait
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.ite import archive as repertoire
from srl_jax.ite import family, trials
from srl_jax.types import ActState, EndedEpisodes, Params


class ITEState(NamedTuple):
    """The search of one lane's robot."""

    actor: Params  # {"gait": f32[36]} the best gait tried, or the map's best before the first trial
    critic: tuple
    trials: trials.TrialState
    seconds: jax.Array  # f32[] of robot time that the trials took
    cell: jax.Array  # i32[] of the map, whose gait is being tried
    gait: jax.Array  # f32[36] of that cell
    over: jax.Array  # bool[] good enough, or no trial left
    since: jax.Array  # i32[] the lane's control step at which this trial began


@lru_cache(maxsize=4)
def prior_map(path: str = "") -> tuple[trials.GaitMap, jax.Array]:
    """The filled cells of a repertoire (the shipped one where `path` is empty) and their gaits f32[N, 36].

    Raises:
        ValueError: the file cannot be read, or its gaits were walked at another frequency than this robot's clock has.
    """
    with jax.ensure_compile_time_eval():  # a constant of whatever program asks first
        found = repertoire.load(path)
        clock, own = found.about["clock_hz"], float(gait.load().frequency)
        if abs(clock - own) > 1e-3:
            raise ValueError(f"repertoire {path} was made with clock_hz={clock:g}; the robot's clock has {own:g}.")
        return trials.make_map(found.descriptors, found.fitness), found.gaits


def process_settings(hyper: Hyper) -> trials.ProcessSettings:
    """The process's settings from a lane's hyper-parameters."""
    return trials.ProcessSettings(hyper.rho, hyper.prior, hyper.trial_noise, hyper.kappa, hyper.sufficient)


def init(
    key: jax.Array,
    observation_size: int,
    action_size: int,
    *,
    config: ITEConfig,
    teachers: Sequence[Teacher] = (),
) -> ITEState:
    """A search before its first trial, of the map's best gait; arguments as `ddpg.init`."""
    del key, observation_size, action_size, teachers
    return search(config)


def search(config: ITEConfig) -> ITEState:
    """A search before its first trial."""
    prior, gaits = prior_map(config.repertoire)
    first = jnp.argmax(prior.fitness).astype(jnp.int32)
    return ITEState(
        actor={"gait": gaits[first]},
        critic=(),
        trials=trials.init(config.trials),
        seconds=jnp.zeros(()),
        cell=first,
        gait=jnp.copy(gaits[first]),  # donated buffers must not alias
        over=jnp.zeros((), bool),
        since=jnp.zeros((), jnp.int32),
    )


def policy(actor: Params, observation: jax.Array) -> jax.Array:
    """The action f32[18] of a gait at the observed clock."""
    phase = jnp.arctan2(observation[0], observation[1]) / (2.0 * jnp.pi)
    return family.action(actor["gait"], jnp.mod(phase, 1.0))


def student(actor: Params, observation: jax.Array, *, config: ITEConfig, teachers: Sequence[Teacher] = ()) -> jax.Array:
    """The action f32[18] of the best gait tried."""
    del config, teachers
    return policy(actor, observation)


def act(
    state: ITEState,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    config: ITEConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[jax.Array, ActState]:
    """The action of the gait on trial, or of the best once the search is over; as `ddpg.act`."""
    del key, config, hyper, step, teachers
    walked = jnp.where(state.over, state.actor["gait"], state.gait)
    return policy({"gait": walked}, observation), act_state


def finish(state: ITEState, episodes: EndedEpisodes, *, config: ITEConfig, hyper: Hyper) -> ITEState:
    """Records the first environment's trial where one has ended, and chooses the next gait (Cully et al., Methods)."""
    own = jax.tree.map(lambda x: x[0], episodes)
    counts = own.ended & ~state.over & (own.began >= state.since)
    tried = partial(after_trial, config=config, hyper=hyper)
    return jax.lax.cond(counts, tried, lambda state, own: state, state, own)


def after_trial(state: ITEState, episode: EndedEpisodes, *, config: ITEConfig, hyper: Hyper) -> ITEState:
    """The search after one more trial, an episode without leading axis."""
    prior, gaits = prior_map(config.repertoire)
    done = trials.record(state.trials, state.cell, episode.distance)
    mean, deviation = trials.posterior(prior, done, process_settings(hyper))
    cell = trials.choose(mean, deviation, process_settings(hyper))
    best, _ = trials.best(done)
    return ITEState(
        actor={"gait": gaits[best]},
        critic=(),
        trials=done,
        seconds=state.seconds + (episode.now - episode.began) / CONTROL_HZ,
        cell=cell,
        gait=gaits[cell],
        over=trials.sufficient(mean, done, process_settings(hyper)) | (done.count >= config.trials),
        since=episode.now,
    )


def gauge(state: ITEState) -> Metrics:
    """How far the search is, each f32[].

    Trials made, their robot time (s), the row of the repertoire that the best of them walked by, how far it came (m),
    and whether the search is over.
    """
    some, (cell, reached) = state.trials.count > 0, trials.best(state.trials)
    measured = {
        "trials": state.trials.count,
        "trial_seconds": state.seconds,
        "trial_gait": jnp.where(some, cell, state.cell),
        "trial_best": jnp.where(some, reached, 0.0),
        "trial_over": state.over,
    }
    return {name: value.astype(jnp.float32) for name, value in measured.items()}


def reopen(state: ITEState, now: jax.Array, *, config: ITEConfig) -> ITEState:
    """The search begun anew at the lane's control step i32[], after another damage; robot time goes on counting.

    What was tried before tells nothing of the new body, but the best gait of the old one is what the robot walks by
    until a trial has been made.
    """
    fresh = search(config)
    return fresh._replace(actor=state.actor, seconds=state.seconds, since=now)


def agent(config: ITEConfig) -> Agent:
    """Trial and error as the program knows it."""
    return Agent(
        init=partial(init, config=config),
        act=partial(act, config=config),
        student=partial(student, config=config),
        finish=partial(finish, config=config),
        gauge=gauge,
        reopen=partial(reopen, config=config),
    )
