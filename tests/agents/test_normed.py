"""LayerNorm and ReLU in one against flax's, values and gradients."""

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents.normed import NormRelu

WIDTH = 8


class Plain(nn.Module):
    @nn.compact
    def __call__(self, x):
        return nn.relu(nn.LayerNorm(name="norm")(x))


class Ours(nn.Module):
    @nn.compact
    def __call__(self, x):
        return NormRelu(name="norm")(x)


def parameters(key, *lead):
    scale, bias = 1.0 + 0.3 * jax.random.normal(key, (2, *lead, WIDTH))
    return {"params": {"norm": {"scale": scale, "bias": bias - 1.0}}}


def outcome(module, params, x):
    """The output, and the gradients of a number made of it."""

    def number(params, x):
        y = module.apply(params, x)
        return jnp.sum(y * jnp.cos(jnp.arange(y.size).reshape(y.shape))), y

    gradients, y = jax.grad(number, argnums=(0, 1), has_aux=True)(params, x)
    return y, gradients


def assert_close(found, wanted):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=2e-5, atol=2e-5), found, wanted)


@pytest.mark.parametrize("shape", [(), (5,), (3, 5)])
def test_it_is_flaxs(shape):
    x, params = 3.0 * jax.random.normal(jax.random.key(0), (*shape, WIDTH)) + 1.0, parameters(jax.random.key(1))
    found, wanted = outcome(Ours(), params, x), outcome(Plain(), params, x)
    assert 0 < jnp.sum(wanted[0] == 0) < wanted[0].size, "some units are off, others on"
    assert_close(found, wanted)
    fresh = [jax.tree.map(jnp.shape, module.init(jax.random.key(2), x)) for module in (Ours(), Plain())]
    assert fresh[0] == fresh[1]


def test_lanes_and_members_have_their_own_parameters():
    x, params = jax.random.normal(jax.random.key(0), (2, 5, WIDTH)), parameters(jax.random.key(1), 2, 3)
    both = [
        jax.jit(jax.vmap(jax.vmap(lambda p, x, m=module: outcome(m, p, x), (0, None)), (0, 0)))(params, x)
        for module in (Ours(), Plain())
    ]
    assert_close(*both)


def test_a_lane_that_is_not_finite_leaves_the_others_alone():
    x, params = jax.random.normal(jax.random.key(0), (3, 5, WIDTH)), parameters(jax.random.key(1), 3)
    each = jax.jit(jax.vmap(lambda p, x: outcome(Ours(), p, x)))
    for bad in (jnp.nan, jnp.inf, -jnp.inf):
        found, wanted = each(params, x.at[0, 0, 0].set(bad)), each(params, x)
        assert not jnp.isfinite(found[0][0]).all()
        jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[1:], b[1:]), found, wanted)
