"""Actor and critic networks; the critic takes its dropout masks as an argument."""

from collections.abc import Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp

from srl_jax.agents.settings import ActorConfig

_small = nn.initializers.variance_scaling(1e-2, "fan_in", "uniform")
_hidden = nn.initializers.variance_scaling(1.0 / 3.0, "fan_in", "uniform")


class Torso(nn.Module):
    """Dense layers with optional LayerNorm, ReLU, and an optional multiplicative mask after each."""

    hidden: Sequence[int]
    layer_norm: bool

    @nn.compact
    def __call__(self, x: jax.Array, masks: tuple | None = None) -> jax.Array:
        for layer, width in enumerate(self.hidden):
            x = nn.Dense(width, kernel_init=_hidden)(x)
            if self.layer_norm:
                x = nn.LayerNorm()(x)
            x = nn.relu(x)
            if masks is not None:
                x = x * masks[layer]
        return x


class Actor(nn.Module):
    """Deterministic policy f32[O] -> f32[A] in [-1, 1]."""

    hidden: Sequence[int]
    action_size: int
    layer_norm: bool

    @nn.compact
    def __call__(self, observation: jax.Array) -> jax.Array:
        x = Torso(self.hidden, self.layer_norm)(observation)
        return jnp.tanh(nn.Dense(self.action_size, kernel_init=_small, name="action")(x))


class Critic(nn.Module):
    """Action value (f32[O], f32[A], masks) -> f32[]."""

    hidden: Sequence[int]
    layer_norm: bool

    @nn.compact
    def __call__(self, observation: jax.Array, action: jax.Array, masks: tuple | None = None) -> jax.Array:
        x = jnp.concatenate([observation, action], axis=-1)
        x = Torso(self.hidden, self.layer_norm)(x, masks)
        return nn.Dense(1, kernel_init=_small)(x)[..., 0]


def network_sizes(config: ActorConfig, observation_size: int, action_size: int) -> tuple[int, int]:
    """Scalars in an actor and in the whole critic ensemble, without allocating them."""
    key, o, a = jax.random.key(0), jnp.zeros(observation_size), jnp.zeros(action_size)
    actor = jax.eval_shape(Actor(config.hidden, action_size, config.layer_norm).init, key, o)
    critic = jax.eval_shape(Critic(config.hidden, config.layer_norm).init, key, o, a)
    count = [sum(leaf.size for leaf in jax.tree.leaves(params)) for params in (actor, critic)]
    return count[0], getattr(config, "critics", 0) * count[1]
