"""The step of one robot, which `vmap` makes the step of all: laid side by side, in blocks that fit the cache."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp

from srl_jax.env.star.body import Body, Ground, body
from srl_jax.env.star.constants import Star
from srl_jax.env.star.contacts import Model
from srl_jax.env.star.stepper import State, steps

BLOCK = 256  # robots that stay in a core's L2 cache; half as many cost a third more each, twice as many a tenth
VECTOR = 16  # f32 in the widest register: what is left over would be stepped one by one


def simulate(
    star: Star, leaves: Model, control: jax.Array, state: State, count: int, ground: Ground | None = None
) -> State:
    """`count` physics steps of one robot under constant position targets; made for `vmap`.

    Args:
        star: of the model.
        leaves: the model, or an object with those of its leaves that damage changes.
        control: f[nu] rad.
        state: before.
        count: steps.
        ground: where it is not the model's.

    Returns:
        The state after them.
    """
    one = jax.tree.map(lambda x: x[None], (body(star, leaves, ground), control, state))
    return jax.tree.map(lambda x: x[0], _stepped(star, count)(*one))


@cache
def _stepped(star: Star, count: int):
    """The step of n robots, leaves [n, ...], whose `vmap` over m is the step of m n."""

    @jax.custom_batching.custom_vmap
    def stepped(*rows):
        return _in_blocks(star, rows, count)

    @stepped.def_vmap
    def _(size: int, batched: Any, *rows):
        def flat(x: jax.Array, along: bool) -> jax.Array:
            x = x if along else jnp.broadcast_to(x[None], (size, *x.shape))
            return x.reshape(-1, *x.shape[2:])

        out = stepped(*jax.tree.map(flat, rows, tuple(batched)))
        out = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return stepped


def _in_blocks(star: Star, rows: tuple[Body, jax.Array, State], count: int) -> State:
    """Steps n robots, filled up to whole blocks by repeating the last one; leaves [n, ...]."""
    n = rows[1].shape[0]
    blocks = -(-n // BLOCK) if jax.default_backend() == "cpu" else 1
    size = -(-n // (blocks * VECTOR)) * VECTOR if n > 1 else 1

    def laid(x: jax.Array) -> jax.Array:
        x = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * size - n, *x.shape[1:]))])
        return jnp.moveaxis(x.reshape(blocks, size, *x.shape[1:]), 1, -1)

    def block(args: tuple[Body, jax.Array, State]) -> State:
        with jax.numpy_rank_promotion("allow"):  # per robot [B] meets per leg [L, B] and constants [L, 1] all over
            return steps(star, *args, count)

    laid_rows = jax.tree.map(laid, rows)
    if blocks == 1:
        out = jax.tree.map(lambda x: x[None], block(jax.tree.map(lambda x: x[0], laid_rows)))
    else:
        out = jax.lax.map(block, laid_rows)
    return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 1).reshape(blocks * size, -1)[:n], out)
