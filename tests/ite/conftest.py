"""The walk of a batch of gaits, compiled once for all tests that use it."""

import jax
import pytest

ROWS, DEVICES = 16, 2


@pytest.fixture(scope="session")
def walker():
    """(damage name, gaits f32[n <= 16, 36]) -> `Walk` of n rows; two blocks of four on each of two devices."""
    import numpy as np

    from srl_jax.env import damage
    from srl_jax.ite import family, walk

    program = jax.jit(walk.make(walk.devices_mesh(DEVICES), block=4))

    def walked(name, gaits):
        rows = np.tile(family.REFERENCE, (ROWS, 1))
        rows[: len(gaits)] = gaits
        return jax.tree.map(lambda x: np.asarray(x)[: len(gaits)], program(damage.build(name), rows))

    return walked
