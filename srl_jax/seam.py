"""Where one stage of a computation ends and the next begins: values to be computed once, not in every consumer.

XLA fuses what it can, and recomputes a shared value in each kernel that reads it: with hundreds of shared values a
physics step took a hundred times as long. `jax.lax.optimization_barrier` does not help, it is removed before fusion.
"""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree")


class Seam:
    """A fusion barrier that copies nothing: a loop over all values that runs zero times, which XLA cannot know.

    Its body turns values of one shape around, so that no simplification sees through it. It costs .15 us on a CPU.
    """

    def __init__(self, never: jax.Array):
        """`never` i32[] is 0 whenever the program runs, but not a constant."""
        self.never = never

    def __call__(self, tree: Tree) -> Tree:
        """The same tree; its arrays are computed before anything that follows. Plain numbers pass by."""
        leaves, structure = jax.tree.flatten(tree)
        alike: dict[tuple, list[int]] = {}
        for place, leaf in enumerate(leaves):
            if isinstance(leaf, jax.Array):
                alike.setdefault((leaf.shape, leaf.dtype), []).append(place)
        groups = [[leaves[i] for i in places] for places in alike.values()]

        def body(carry):
            count, groups = carry
            return count + 1, [_turned(group) for group in groups]

        start = jnp.zeros((), jnp.int32), groups
        _, groups = jax.lax.while_loop(lambda carry: carry[0] < self.never, body, start)
        for places, group in zip(alike.values(), groups, strict=True):
            for place, leaf in zip(places, group, strict=True):
                leaves[place] = leaf
        return jax.tree.unflatten(structure, leaves)


def _turned(group: list[jax.Array]) -> list[jax.Array]:
    if len(group) > 1:
        return [*group[1:], group[0]]
    return [~group[0] if group[0].dtype == bool else group[0] + 1]


def seam(tree: Tree) -> Tree:
    """A `Seam` whose `never` is taken from the first array itself: no number is above infinity.

    Under `vmap` the loop stays one loop of all rows, since one row's number serves.
    """
    leaves, structure = jax.tree.flatten(tree)
    first = leaves[0].reshape(-1)[0]
    return jax.tree.unflatten(structure, _barrier((first > jnp.inf).astype(jnp.int32), leaves))


@jax.custom_batching.custom_vmap
def _barrier(never: jax.Array, leaves: list[jax.Array]) -> list[jax.Array]:
    return Seam(never)(leaves)


@_barrier.def_vmap
def _(size: int, batched: Any, never: jax.Array, leaves: list[jax.Array]):
    never = never[0] if batched[0] else never
    leaves = [
        x if own else jnp.broadcast_to(x[None], (size, *x.shape)) for x, own in zip(leaves, batched[1], strict=True)
    ]
    return _barrier(never, leaves), [True] * len(leaves)
