"""What tests of the compiled program compare: rows of its arrays."""

import jax
import jax.numpy as jnp
import numpy as np


def row(tree, index):
    """One row of a pytree as NumPy arrays."""
    return jax.tree.map(lambda x: np.asarray(jax.random.key_data(x) if _is_key(x) else x)[index], tree)


def _is_key(x):
    return jnp.issubdtype(x.dtype, jax.dtypes.prng_key)


def assert_same(left, right):
    jax.tree.map(np.testing.assert_array_equal, left, right)


def rows_of_lane(state, engine, index):
    """Everything that the lane in a row owns: its robots, its agent, its replay if it has one."""
    layout = engine.program.layout
    algo = layout.rows[index].algo
    position = layout.rows_of[algo].tolist().index(index)
    own = [state.agents[algo], *([state.replay[algo]] if algo in state.replay else [])]
    return row((state.world, state.alive), index), row(own, position)
