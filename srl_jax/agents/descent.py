"""Descent with rates that are values, since lanes may differ in them."""

from typing import Any

import jax
import jax.numpy as jnp
import optax

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.settings import ActorConfig
from srl_jax.types import Params


def optimiser(name: str) -> optax.GradientTransformation:
    """The direction of descent of ``adam`` or ``rmsprop``; the learning rate is applied by `descend`."""
    return optax.scale_by_adam() if name == "adam" else optax.scale_by_rms()


def descend(params: Params, direction: Params, rate: jax.Array) -> Params:
    """``params - rate * direction``."""
    return jax.tree.map(lambda p, d: p - rate * d, params, direction)


def move_actor(state: Any, gradient: Params, *, config: ActorConfig, hyper: Hyper, step: jax.Array) -> Any:
    """The state after one descent step of its actor along a gradient; none while the actor is frozen."""
    direction, opt = optimiser(config.actor_optimiser).update(gradient, state.actor_optimiser)
    rate = jnp.where(step >= hyper.freeze, hyper.actor_lr, 0.0)
    return state._replace(actor=descend(state.actor, direction, rate), actor_optimiser=opt)


def track(online: Params, target: Params, *, hyper: Hyper) -> Params:
    """Soft update ``target <- (1 - tau) target + tau online``."""
    return optax.incremental_update(online, target, hyper.tau)
