"""Lanes whose robots carry different damages: each draws one of the lane's mix whenever its episode starts."""

from typing import TypeVar

import jax

DRAW = 4  # of a robot's key: which damage it carries

Tree = TypeVar("Tree")


def draw(count: int, key: jax.Array) -> jax.Array:
    """The number i32[] of the damage, of so many, that a robot carries, by its key at the start of an episode."""
    return jax.random.randint(jax.random.fold_in(key, DRAW), (), 0, count)


def taken(mix: Tree, number: jax.Array | int) -> Tree:
    """What belongs to damages of a mix, leaves [*N, ...], of what belongs to all of it, leaves [M, ...]; i32[*N]."""
    return jax.tree.map(lambda leaf: leaf[number], mix)
