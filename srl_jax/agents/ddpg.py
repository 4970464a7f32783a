"""DDPG (Lillicrap et al. 2016) with an ensemble of critics, as pure functions: init, act, update.

The pieces of its update (`critic_step`, `actor_step`, `learn_critic`) are what the other agents are built from.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import optax

from srl_jax.agents import descent, ensemble, noise
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.networks import Actor
from srl_jax.agents.settings import ActorConfig, DDPGConfig
from srl_jax.types import ActState, Params, Transition

METRICS = ("critic_loss", "q")


class AgentState(NamedTuple):
    """Networks and optimisers; critic leaves have a leading axis K (members of the ensemble)."""

    actor: Params
    critic: Params
    target_actor: Params
    target_critic: Params
    actor_optimiser: optax.OptState
    critic_optimiser: optax.OptState


def student(
    actor: Params, observation: jax.Array, *, config: ActorConfig, teachers: Sequence[Teacher] = ()
) -> jax.Array:
    """The deterministic policy f32[..., O] -> f32[..., A]; it asks no teacher."""
    del teachers
    size = actor["params"]["action"]["bias"].shape[-1]
    return Actor(config.hidden, size, config.layer_norm).apply(actor, observation)  # type: ignore[return-value]


def init(
    key: jax.Array,
    observation_size: int,
    action_size: int,
    *,
    config: DDPGConfig,
    teachers: Sequence[Teacher] = (),
    heads: int = 0,
) -> AgentState:
    """Fresh networks, with `heads` of the critics (see `ensemble.init`); targets start as copies."""
    del teachers
    actor_key, critic_key = jax.random.split(key)
    actor = Actor(config.hidden, action_size, config.layer_norm).init(actor_key, jnp.zeros(observation_size))
    critic = ensemble.init(critic_key, observation_size, action_size, config=config, heads=heads)
    return AgentState(
        actor=actor,
        critic=critic,
        target_actor=jax.tree.map(jnp.copy, actor),
        target_critic=jax.tree.map(jnp.copy, critic),
        actor_optimiser=descent.optimiser(config.actor_optimiser).init(actor),
        critic_optimiser=descent.optimiser(config.critic_optimiser).init(ensemble.learned(critic, config=config)),
    )


def act(
    state: Any,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    config: ActorConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[jax.Array, ActState]:
    """The student's action with exploration noise.

    Args:
        state: whose ``actor`` acts.
        act_state: noise and guidance carried by this environment (see `types.ActState`).
        observation: f32[O].
        key: random key.
        config: static settings.
        hyper: numeric settings.
        step: f32[] environment steps taken so far by the lane (the shared clock).
        teachers: ignored here; SRL chooses among them.

    Returns:
        action f32[A] in [-1, 1] and the new act_state, whose ``guidance.choice`` says who acted.
    """
    del teachers
    return noise.explore(student(state.actor, observation, config=config), act_state, key, hyper=hyper, step=step)


def critic_step(
    state: AgentState,
    loss: Callable[[Params], tuple[jax.Array, Metrics]],
    *,
    config: DDPGConfig,
    hyper: Hyper,
) -> tuple[AgentState, Metrics]:
    """One descent step of what learns in the critic ensemble on ``loss(params) -> (f32[], metrics)``."""
    whole = partial(ensemble.with_learned, state.critic, config=config)
    learned = ensemble.learned(state.critic, config=config)
    gradient, metrics = jax.grad(lambda new: loss(whole(new)), has_aux=True)(learned)
    direction, opt = descent.optimiser(config.critic_optimiser).update(gradient, state.critic_optimiser)
    critic = whole(descent.descend(learned, direction, hyper.critic_lr))
    return state._replace(critic=critic, critic_optimiser=opt), metrics


def actor_step(
    state: AgentState,
    loss: Callable[[Params], tuple[jax.Array, Metrics]],
    *,
    config: DDPGConfig,
    hyper: Hyper,
    step: jax.Array,
) -> tuple[AgentState, Metrics]:
    """One descent step of the actor on ``loss(params) -> (f32[], metrics)``; none while the actor is frozen."""
    gradient, metrics = jax.grad(loss, has_aux=True)(state.actor)
    return descent.move_actor(state, gradient, config=config, hyper=hyper, step=step), metrics


def learn_critic(
    state: AgentState,
    batch: Transition,
    key: jax.Array,
    step: Callable[[AgentState, Transition, jax.Array], tuple[AgentState, Metrics]],
    *,
    config: DDPGConfig,
    hyper: Hyper,
) -> tuple[AgentState, Metrics]:
    """``step(state, mini_batch, key)`` on each of `config.critic_updates` parts of the batch; the target follows.

    Args:
        state: networks and optimisers.
        batch: transitions with a leading axis ``critic_updates * B``.
        key: random key.
        step: one descent step of the critic.
        config: static settings.
        hyper: numeric settings.

    Returns:
        The new state, and its metrics averaged over the steps.
    """
    count = config.critic_updates
    chex.assert_equal_shape_prefix(batch, 1)
    chex.assert_is_divisible(batch.reward.shape[0], count)

    def once(state: AgentState, part: tuple[Transition, jax.Array]) -> tuple[AgentState, Metrics]:
        state, metrics = step(state, *part)
        target = ensemble.follow(state.critic, state.target_critic, config=config, hyper=hyper)
        return state._replace(target_critic=target), metrics

    parts = jax.tree.map(lambda x: x.reshape(count, -1, *x.shape[1:]), batch)
    state, metrics = jax.lax.scan(once, state, (parts, jax.random.split(key, count)))
    return state, jax.tree.map(jnp.mean, metrics)


def last_part(batch: Transition, config: DDPGConfig) -> Transition:
    """The mini-batch B that the actor learns from: the last of the critic's."""
    size = batch.reward.shape[0] // config.critic_updates
    return jax.tree.map(lambda x: x[-size:], batch)


def update(
    state: AgentState,
    batch: Transition,
    key: jax.Array,
    *,
    config: DDPGConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[AgentState, Metrics]:
    """One update of critic, actor and targets (Lillicrap et al. 2016, Alg. 1).

    Args:
        state: networks and optimisers.
        batch: transitions with a leading axis ``critic_updates * B``, one mini-batch for each step of the critic.
        key: random key.
        config: static settings.
        hyper: numeric settings.
        step: f32[] environment steps taken so far by the lane.
        teachers: ignored here.

    Returns:
        The new state and scalar metrics ``critic_loss``, ``q``.
    """
    del teachers

    def descend_critic(state: AgentState, part: Transition, key: jax.Array) -> tuple[AgentState, Metrics]:
        del key
        next_action = student(state.target_actor, part.next_observation, config=config)
        target = ensemble.td_target(state.target_critic, part, next_action, config=config, hyper=hyper)

        def loss(params: Params) -> tuple[jax.Array, Metrics]:
            error = ensemble.q_values(params, part.observation, part.action, config=config) - target
            total = jnp.mean(jnp.square(error), axis=1).sum()  # members share no parameters: a sum, not a mean
            return total, {"critic_loss": total / config.critics}

        return critic_step(state, loss, config=config, hyper=hyper)

    state, critic_metrics = learn_critic(state, batch, key, descend_critic, config=config, hyper=hyper)
    observation = last_part(batch, config).observation

    def actor_loss(params: Params) -> tuple[jax.Array, Metrics]:
        action = student(params, observation, config=config)
        q = jnp.mean(ensemble.q_values(state.critic, observation, action, config=config))
        return -q, {"q": q}

    state, actor_metrics = actor_step(state, actor_loss, config=config, hyper=hyper, step=step)
    target_actor = descent.track(state.actor, state.target_actor, hyper=hyper)
    return state._replace(target_actor=target_actor), critic_metrics | actor_metrics


def adopt(state: AgentState, actor: Params) -> AgentState:
    """The agent with another actor, online and target; a copy, since donated buffers must not alias."""
    return state._replace(actor=actor, target_actor=jax.tree.map(jnp.copy, actor))


def agent(config: DDPGConfig) -> Agent:
    """DDPG as the program knows it."""
    return Agent(
        init=partial(init, config=config),
        act=partial(act, config=config),
        student=partial(student, config=config),
        update=partial(update, config=config),
        batch_size=config.batch * config.critic_updates,
        metrics=METRICS,
        adopt=adopt if config.init == "behaviour" else None,
        network=config,
    )
