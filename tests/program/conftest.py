"""What tests of the compiled program share: the rows' constants, and states after some steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.job import start
from srl_jax.program import tally as tallies
from srl_jax.program.state import TRAIN


@pytest.fixture(scope="session")
def data(engine, tiny, teachers):
    """The rows' constants."""
    names = [lane.damage for lane in engine.program.layout.rows]
    return start.make_lanes(engine.program, tiny, teachers, "train", names)


@pytest.fixture(scope="session")
def fresh(engine, data):
    """() -> a state at step 0, which is made once and copied, since a chunk takes what it is given."""
    state = start.init_state(engine, data)
    return lambda: jax.tree.map(jnp.copy, state)


@pytest.fixture(scope="session")
def trained(engine, fresh):
    """(data, steps, edit, mode) -> a fresh state, edited, after some vector steps, and its tally."""

    def advance(data, steps, edit=lambda state: state, mode=None):
        return engine.chunk(edit(fresh()), tallies.empty(engine.program), data, mode or TRAIN(), steps)

    return advance


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
