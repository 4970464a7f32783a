"""Episodic policy gradients over the parameters of a gait: a Gaussian policy whose every action is a whole episode.

A robot draws the parameters ``theta = mean + deviation * z`` when its episode starts and walks by them to its end. M
such trajectories make one step along the natural gradient, estimated by Monte-Carlo (`mcpg`; Williams 1992) or by
Bayesian quadrature (`bpg`; Ghavamzadeh & Engel 2006). In z the scores are ``u = [z, z^2 - 1]`` and their Fisher
information is ``diag(1, 2)``, known exactly whatever the gait.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jax.tree_util import Partial

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics
from srl_jax.agents.settings import SearchConfig
from srl_jax.bayes import quadrature
from srl_jax.types import ActState, EndedEpisodes, Params

GAUGES = ("search_deviation", "gradient_norm", "gradient_deviation", "gradient_failed")
LARGEST = 100  # parameters of a policy that a dense covariance is kept for


class SearchState(NamedTuple):
    """The Gaussian over n parameters, relative to pi_B's, and the M trajectories since its last step."""

    actor: Params  # {"offset": f32[n]} the mean, minus pi_B's parameters
    critic: tuple
    log_scale: jax.Array  # f32[n] logarithm of the standard deviations over `hyper.spread`
    draws: jax.Array  # f32[M, n] z of each trajectory
    returns: jax.Array  # f32[M]
    count: jax.Array  # i32[] trajectories so far
    since: jax.Array  # i32[] the lane's control step at which the Gaussian took its last step
    metrics: Metrics  # f32[] each, of the last step


def init(
    key: jax.Array,
    observation_size: int,
    action_size: int,
    *,
    config: SearchConfig,
    teachers: Sequence[Any] = (),
) -> SearchState:
    """A search that starts at pi_B's parameters, which are the arguments of ``teachers[0]``; arguments as `ddpg.init`.

    Raises:
        ValueError: pi_B has too many parameters to search, as a network has.
    """
    del key, observation_size, action_size
    size = ravel_pytree(teachers[0].args)[0].size
    if size > LARGEST:
        raise ValueError(
            f"behaviour has {size} parameters, and a search over a policy's parameters takes at most {LARGEST}: "
            "use --behaviour gait with it."
        )
    return SearchState(
        actor={"offset": jnp.zeros(size)},
        critic=(),
        log_scale=jnp.zeros(size),
        draws=jnp.zeros((config.trajectories, size)),
        returns=jnp.zeros(config.trajectories),
        count=jnp.zeros((), jnp.int32),
        since=jnp.zeros((), jnp.int32),
        metrics={name: jnp.zeros(()) for name in GAUGES},
    )


def moved(teacher: Partial, offset: jax.Array, observation: jax.Array) -> jax.Array:
    """The action f32[A] of a teacher whose parameters are moved by f32[n]."""
    values, unravel = ravel_pytree(teacher.args)
    return teacher.func(*unravel(values + offset), observation)


def deviation(state: SearchState, hyper: Hyper) -> jax.Array:
    """Standard deviations f32[n] of the Gaussian, not below the floor."""
    return jnp.maximum(hyper.spread * jnp.exp(state.log_scale), hyper.spread_floor)


def draw(seed: jax.Array, size: int) -> jax.Array:
    """z f32[n] of the episode with this seed u32[]: drawn once, recalled at every step."""
    return jax.random.normal(jax.random.key(seed), (size,))


def student(actor: Params, observation: jax.Array, *, config: SearchConfig, teachers: Sequence[Any] = ()) -> jax.Array:
    """The action f32[A] of the Gaussian's mean."""
    del config
    return moved(teachers[0], actor["offset"], observation)


def act(
    state: SearchState,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    config: SearchConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Any] = (),
) -> tuple[jax.Array, ActState]:
    """The action of the episode's parameters; arguments and results as `ddpg.act`."""
    del key, config, step
    assert act_state.seed is not None
    offset = state.actor["offset"]
    offset = offset + deviation(state, hyper) * draw(act_state.seed, offset.size)
    return moved(teachers[0], offset, observation), act_state


def finish(state: SearchState, episodes: EndedEpisodes, *, config: SearchConfig, hyper: Hyper) -> SearchState:
    """Keeps the trajectories that have ended; at M of them the Gaussian takes a step, before any robot starts anew.

    Episodes that other robots are still in the middle of then began under the old Gaussian; they are left out later.

    Args:
        state: the search.
        episodes: leading axis E.
        config: static settings.
        hyper: numeric settings.
    """
    size = state.actor["offset"].size
    fresh = episodes.ended & (episodes.began >= state.since)
    place = jnp.where(fresh, state.count + jnp.cumsum(fresh) - 1, config.trajectories)  # out of range: dropped
    draws = jax.vmap(lambda seed: draw(seed, size))(episodes.seed)
    state = state._replace(
        draws=state.draws.at[place].set(draws, mode="drop"),
        returns=state.returns.at[place].set(episodes.returns, mode="drop"),
        count=state.count + jnp.sum(fresh),
    )
    full = state.count >= config.trajectories
    step = partial(ascend, config=config, hyper=hyper)
    return jax.lax.cond(full, lambda: step(state)._replace(since=jnp.max(episodes.now)), lambda: state)


def ascend(state: SearchState, *, config: SearchConfig, hyper: Hyper) -> SearchState:
    """One step along the natural gradient of the M trajectories' standardised returns; none where it failed."""
    size = state.actor["offset"].size
    estimate = {
        "monte_carlo": quadrature.monte_carlo,
        "model1": quadrature.model1,
        "model2": quadrature.model2,
    }[config.estimator]
    scores = jnp.concatenate([state.draws, jnp.square(state.draws) - 1.0], axis=1)
    fisher = jnp.diag(jnp.repeat(jnp.array([1.0, 2.0]), size))
    returns = (state.returns - jnp.mean(state.returns)) / (jnp.std(state.returns) + 1e-6)
    gradient = estimate(scores, returns, fisher, noise=hyper.return_noise)
    natural = quadrature.natural(gradient, fisher).mean
    width = deviation(state, hyper)
    log_scale = state.log_scale + hyper.search_rate * natural[size:]
    return state._replace(
        actor={"offset": state.actor["offset"] + hyper.search_rate * width * natural[:size]},
        log_scale=jnp.clip(log_scale, jnp.log(hyper.spread_floor / hyper.spread), 1.0),
        count=jnp.zeros_like(state.count),
        metrics={
            "search_deviation": jnp.mean(width),
            "gradient_norm": jnp.linalg.norm(natural),
            "gradient_deviation": jnp.sqrt(jnp.mean(jnp.diagonal(gradient.covariance))),
            "gradient_failed": 1.0 - gradient.ok.astype(jnp.float32),
        },
    )


def agent(config: SearchConfig) -> Agent:
    """An episodic search as the program knows it; what its last step measured stands in the state."""
    return Agent(
        init=partial(init, config=config),
        act=partial(act, config=config),
        student=partial(student, config=config),
        finish=partial(finish, config=config),
        gauge=lambda state: state.metrics,
    )
