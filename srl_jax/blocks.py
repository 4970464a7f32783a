"""Mapping over rows in blocks that fit the cache: past it, one wide vmap halves the speed of small matrix products."""

from collections.abc import Callable
from typing import Any

import jax


def block_size(count: int, wanted: int) -> int:
    """The largest divisor of `count` that is at most `wanted` (0: `count` itself), so that no remainder is compiled."""
    if wanted <= 0 or wanted >= count:
        return count
    return max(size for size in range(1, wanted + 1) if count % size == 0)


def blocked_map(batched: Callable[[Any], Any], rows: Any, wanted: int) -> Any:
    """Applies a function of stacked rows block by block.

    Args:
        batched: function of a pytree with leading axis b, for any b; returns a pytree with leading axis b.
        rows: pytree with leading axis n.
        wanted: rows per block, at most; 0 for all at once.

    Returns:
        The pytree that ``batched(rows)`` returns.
    """
    count = jax.tree.leaves(rows)[0].shape[0]
    size = block_size(count, wanted)
    if size == count:
        return batched(rows)
    blocks = jax.tree.map(lambda x: x.reshape(count // size, size, *x.shape[1:]), rows)
    result = jax.lax.map(batched, blocks)
    return jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), result)
