"""Starting from pi_B: its own parameters where it is a network, behaviour cloning where it is scripted."""

from functools import partial

import jax
import jax.numpy as jnp
import optax

from srl_jax.agents.ddpg import student
from srl_jax.agents.interface import Teacher
from srl_jax.agents.networks import Actor
from srl_jax.agents.settings import ActorConfig
from srl_jax.types import Params

BATCH = 128
RATE = 3e-3


def policy(params: Params, observation: jax.Array, *, config: ActorConfig) -> jax.Array:
    """A frozen student as a teacher: parameters and f32[O] -> f32[A]."""
    return student(params, observation, config=config)


def clone(
    teacher: Teacher,
    observations: jax.Array,
    key: jax.Array,
    *,
    config: ActorConfig,
    updates: int,
    action_size: int,
) -> tuple[Params, jax.Array]:
    """An actor that imitates the teacher where the teacher has been.

    Args:
        teacher: observation f32[O] -> action f32[A].
        observations: f32[P, O] visited by the teacher, noise included, so that the clone can correct itself.
        key: random key.
        config: the actor's architecture.
        updates: Adam steps on the mean squared error, the rate falling to 0 along a cosine.
        action_size: A.

    Returns:
        Actor parameters and the mean squared error f32[] over all observations.
    """
    init_key, batch_key = jax.random.split(key)
    actor = Actor(config.hidden, action_size, config.layer_norm).init(init_key, observations[0])
    actions = jax.vmap(teacher)(observations)
    optimiser = optax.adam(optax.cosine_decay_schedule(RATE, updates))
    imitate = partial(student, config=config)

    def error(params: Params, x: jax.Array, y: jax.Array) -> jax.Array:
        return jnp.mean(jnp.square(imitate(params, x) - y))

    def update(carry, step_key: jax.Array):
        params, state = carry
        index = jax.random.randint(step_key, (BATCH,), 0, len(observations))
        gradient = jax.grad(error)(params, observations[index], actions[index])
        direction, state = optimiser.update(gradient, state)
        return (optax.apply_updates(params, direction), state), None

    carry = actor, optimiser.init(actor)
    (actor, _), _ = jax.lax.scan(update, carry, jax.random.split(batch_key, updates))
    return actor, error(actor, observations, actions)
