"""A whole adaptation after damage in one program: trials (`ite.trials`) until a gait is good enough."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.ite.trials import (
    PUBLISHED,
    GaitMap,
    ProcessSettings,
    TrialState,
    best,
    check_shapes,
    choose,
    init,
    posterior,
    record,
    sufficient,
)

SECONDS = 5.0  # of walking per trial


class Adaptation(NamedTuple):
    """A whole search. Rows after the stop repeat the best trial: that is what the robot walks on with."""

    index: jax.Array  # i32[T] cell
    speed: jax.Array  # f32[T] observed fitness
    stopped: jax.Array  # bool[T] the search was over once this trial was done
    choice: jax.Array  # i32[] best tested cell
    best: jax.Array  # f32[] its observed fitness
    trials: jax.Array  # i32[] made until the stop, or T
    seconds: jax.Array  # f32[] of robot time those took
    faults: jax.Array  # i32[] trials with a non-finite outcome


def adapt(
    prior: GaitMap,
    evaluate: Callable[[jax.Array, jax.Array], jax.Array],
    key: jax.Array,
    *,
    trials: int = 20,
    settings: ProcessSettings = PUBLISHED,
    bonus: str = "deviation",
    seconds: float = SECONDS,
) -> Adaptation:
    """Tries gaits until one is good enough, at most `trials` of them.

    Under ``vmap`` the loop ends with the last robot that still searches; those that have stopped are not disturbed.

    Args:
        prior: the map.
        evaluate: ``(index i32[], key) -> f32[]``, the fitness of a cell's gait on the damaged robot; traced once.
        key: random key; trial t gets a key that depends on t alone, not on `trials`.
        trials: T.
        settings: of the process, the bonus and the stop.
        bonus: see `trials.suggest`.
        seconds: robot time of one trial.

    Raises:
        ValueError: `trials` below 1, unknown `bonus`, an empty map, or shapes that do not fit.
    """
    check_shapes(prior)

    def searching(carry: tuple[TrialState, jax.Array, jax.Array]) -> jax.Array:
        return ~carry[2] & (carry[0].count < trials)

    def attempt(carry: tuple[TrialState, jax.Array, jax.Array]) -> tuple[TrialState, jax.Array, jax.Array]:
        value = evaluate(carry[1], jax.random.fold_in(key, carry[0].count))
        state = record(carry[0], carry[1], value)
        mean, deviation = posterior(prior, state, settings)
        return state, choose(mean, deviation, settings, bonus), sufficient(mean, state, settings)

    # Before the first trial all gaits are equally unknown, so it is the map's best, as published.
    first = (init(trials), jnp.argmax(prior.fitness).astype(jnp.int32), jnp.zeros((), bool))
    state, _, done = jax.lax.while_loop(searching, attempt, first)
    return _summary(state, done, seconds)


def _summary(state: TrialState, done: jax.Array, seconds: float) -> Adaptation:
    choice, value = best(state)
    row = jnp.arange(len(state.index))
    return Adaptation(
        index=jnp.where(row < state.count, state.index, choice),
        speed=jnp.where(row < state.count, state.observed, value),
        stopped=done & (row >= state.count - 1),
        choice=choice,
        best=value,
        trials=state.count,
        seconds=jnp.asarray(seconds * state.count, jnp.float32),
        faults=state.faults,
    )
