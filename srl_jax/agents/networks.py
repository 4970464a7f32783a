"""Actor and critic networks; the critic takes its dropout masks as an argument."""

from collections.abc import Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp

from srl_jax.agents.normed import NormRelu

_small = nn.initializers.variance_scaling(1e-2, "fan_in", "uniform")
_hidden = nn.initializers.variance_scaling(1.0 / 3.0, "fan_in", "uniform")
UNIT_HEAD = nn.initializers.variance_scaling(2.0, "fan_in", "uniform")  # outputs of order 1 from LayerNorm and ReLU


class Torso(nn.Module):
    """Dense layers with optional LayerNorm, ReLU, and an optional multiplicative mask after each."""

    hidden: Sequence[int]
    layer_norm: bool

    @nn.compact
    def __call__(self, x: jax.Array, masks: tuple | None = None) -> jax.Array:
        for layer, width in enumerate(self.hidden):
            x = nn.Dense(width, kernel_init=_hidden)(x)
            x = NormRelu(name=f"LayerNorm_{layer}")(x) if self.layer_norm else nn.relu(x)
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
    """Action value (f32[O], f32[A], masks) -> f32[]; where it has `heads`, that of as many policies, f32[heads]."""

    hidden: Sequence[int]
    layer_norm: bool
    head: nn.initializers.Initializer = _small
    heads: int = 0

    @nn.compact
    def __call__(self, observation: jax.Array, action: jax.Array, masks: tuple | None = None) -> jax.Array:
        x = jnp.concatenate([observation, action], axis=-1)
        x = Torso(self.hidden, self.layer_norm)(x, masks)
        if self.heads:
            return nn.Dense(self.heads, kernel_init=self.head, name="heads")(x)
        return nn.Dense(1, kernel_init=self.head)(x)[..., 0]
