"""Bayesian actor-critic (Ghavamzadeh & Engel 2007) for networks: a Gaussian policy around a deterministic actor.

The critic is a Gaussian process of temporal differences over one mini-batch, whose kernel is a state kernel plus the
Fisher kernel of the actor's own scores; the policy gradient then is a weighted sum of those scores, in closed form. The
form by Gram matrices (Akella et al. 2021) needs no matrix of the size of the network.

Replayed actions were chosen by earlier policies: under the present one their scores have neither mean zero nor the
Fisher information as their second moment. Neither is asked of the data, which only say what Q is where they lie. The
Fisher information of the kernel is the present policy's at the batch's states, ``mean_s J(s)' J(s) / sigma^2`` with J
the actor's Jacobian, in closed form over actions (`information`). What stays off-policy are the states: the gradient is
that of the states that were visited, as in other off-policy actor-critics, along the batch's scores.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax

from srl_jax.agents import ddpg, descent, noise
from srl_jax.agents.ddpg import student
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.networks import Actor
from srl_jax.agents.settings import BACConfig
from srl_jax.bayes import gptd, gram
from srl_jax.types import Params, Transition

METRICS = ("explained", "gradient_norm", "gradient_failed")


class BACState(NamedTuple):
    """The actor and its optimiser; the critic is made anew from every mini-batch."""

    actor: Params
    critic: tuple
    actor_optimiser: optax.OptState


def init(
    key: jax.Array,
    observation_size: int,
    action_size: int,
    *,
    config: BACConfig,
    teachers: Sequence[Teacher] = (),
) -> BACState:
    """A fresh actor; arguments as `ddpg.init`."""
    del teachers
    actor = Actor(config.hidden, action_size, config.layer_norm).init(key, jnp.zeros(observation_size))
    return BACState(actor, (), descent.optimiser(config.actor_optimiser).init(actor))


act = ddpg.act


def scores(actor: Params, batch: Transition, deviation: jax.Array, *, config: BACConfig) -> Params:
    """``grad log N(a; pi(s), sigma^2 I)`` with respect to the actor: a pytree of f32[B, ...]."""

    def log_density(params: Params, observation: jax.Array, action: jax.Array) -> jax.Array:
        return -0.5 * jnp.sum(jnp.square((action - student(params, observation, config=config)) / deviation))

    return jax.vmap(jax.grad(log_density), (None, 0, 0))(actor, batch.observation, batch.action)


def information(
    actor: Params, batch: Transition, directions: Params, deviation: jax.Array, *, config: BACConfig
) -> jax.Array:
    """F f32[B, B A] with ``F F' = U' G U`` for scores U and the policy's Fisher information G at the batch's states.

    ``u_i' G u_j = mean_s (J(s) u_i)' (J(s) u_j) / sigma^2``: B Jacobian-vector products, and nothing of G's size.
    """
    policy = lambda params: student(params, batch.observation, config=config)  # noqa: E731
    moved = jax.vmap(lambda score: jax.jvp(policy, (actor,), (score,))[1])(directions)  # f32[B, B states, A]
    return moved.reshape(len(moved), -1) / (deviation * jnp.sqrt(len(moved)))


def update(
    state: BACState,
    batch: Transition,
    key: jax.Array,
    *,
    config: BACConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[BACState, Metrics]:
    """One step of the actor along the posterior mean of its gradient, ``U alpha``; arguments as `ddpg.update`.

    Returns:
        The new state and scalar metrics: ``explained``, the norm of the gradient's mean over that of its prior;
        ``gradient_norm``; ``gradient_failed``, 1 where the process could not be fitted and nothing was learned.
    """
    del key, teachers
    deviation = noise.scale(hyper, step)
    directions = scores(state.actor, batch, deviation, config=config)
    products = gram.matrix(directions)
    value = gptd.rbf(hyper.kernel_length, hyper.value_scale)
    discounts = hyper.gamma * batch.discount
    covariance = gptd.state_kernel(value, batch.observation, batch.next_observation, discounts)
    posterior = gram.posterior(
        products,
        batch.reward,
        covariance,
        noise=hyper.reward_noise,
        scale=hyper.advantage_scale,
        information=information(state.actor, batch, directions, deviation, config=config),
    )
    gradient = gram.combine(posterior.weights, directions)
    # A gradient that could not be estimated is zero, and Adam must not see it either.
    moved = descent.move_actor(state, jax.tree.map(jnp.negative, gradient), config=config, hyper=hyper, step=step)
    state = jax.tree.map(lambda new, old: jnp.where(posterior.ok, new, old), moved, state)
    prior = jnp.sqrt(hyper.advantage_scale * jnp.mean(jnp.diagonal(products)))
    norm = optax.tree.norm(gradient)
    metrics = {"explained": norm / prior, "gradient_norm": norm, "gradient_failed": 1.0 - posterior.ok}
    return state, metrics


def adopt(state: BACState, actor: Params) -> BACState:
    """The agent with another actor."""
    return state._replace(actor=actor)


def agent(config: BACConfig) -> Agent:
    """Bayesian actor-critic as the program knows it."""
    return Agent(
        init=partial(init, config=config),
        act=partial(act, config=config),
        student=partial(student, config=config),
        update=partial(update, config=config),
        batch_size=config.batch,
        metrics=METRICS,
        adopt=adopt if config.init == "behaviour" else None,
        network=config,
    )
