"""Blocks change how rows are computed, never what."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.blocks import block_size, blocked_map


@pytest.mark.parametrize("count", [1, 2, 7, 12, 30])
def test_block_size_is_the_largest_divisor_within_reach(count):
    assert block_size(count, 0) == block_size(count, -1) == count
    for wanted in range(1, count + 3):
        size = block_size(count, wanted)
        assert size == max(d for d in range(1, min(wanted, count) + 1) if count % d == 0)


@pytest.mark.parametrize("wanted", [0, 1, 2, 4, 6, 12, 50])
def test_blocked_map_equals_the_function_of_all_rows(wanted):
    rows = {
        "x": jnp.arange(24.0).reshape(12, 2),
        "n": jnp.arange(12),
        "key": jax.random.split(jax.random.key(0), 12),
    }
    seen = []

    def batched(rows):
        seen.append(rows["x"].shape[0])
        noise = jax.vmap(jax.random.normal)(rows["key"])
        return {"sum": rows["x"].sum(1) + rows["n"], "pair": (rows["x"][:, None] ** 2, noise)}

    result = jax.jit(lambda r: blocked_map(batched, r, wanted))(rows)
    assert set(seen) == {block_size(12, wanted)}
    jax.tree.map(np.testing.assert_array_equal, result, batched(rows))


def test_blocks_do_not_see_each_other():
    batched = lambda x: x - x.mean(keepdims=True)  # noqa: E731
    x = jnp.array([1.0, 3.0, 100.0, 300.0])
    np.testing.assert_array_equal(blocked_map(batched, x, 2), [-1.0, 1.0, -100.0, 100.0])


def test_blocked_map_differentiates():
    gradient = jax.grad(lambda x: blocked_map(jnp.square, x, 2).sum())(jnp.arange(6.0))
    np.testing.assert_array_equal(gradient, 2 * np.arange(6.0))
