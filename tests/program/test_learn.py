"""Mini-batches and healthy replay: what an update is fed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents.hyper import stack
from srl_jax.agents.settings import SRLConfig
from srl_jax.program.learn import mix_prior

LANES, BATCH, WIDTH = 3, 400, 5


def mixed(fractions, decay, step):
    """The share of healthy rows in each lane's mini-batch: own rows are zeros, lane i's healthy ones are i + 1."""
    hyper = stack(SRLConfig(prior_decay=(decay,)), [{"prior_fraction": fraction} for fraction in fractions])
    healthy = jnp.arange(1.0, LANES + 1)[:, None, None] * jnp.ones((LANES, 7, WIDTH))
    keys = jax.random.split(jax.random.key(0), LANES)
    rows = mix_prior(jnp.zeros((LANES, BATCH, WIDTH)), healthy, keys, hyper, jnp.float32(step))
    assert np.all(np.ptp(np.asarray(rows), axis=-1) == 0.0), "transitions are replaced whole"
    for lane, found in enumerate(np.asarray(rows)):
        assert set(np.unique(found)) <= {0.0, lane + 1.0}, "a lane's healthy rows are its own"
    return (np.asarray(rows)[..., 0] > 0.0).mean(axis=1)


@pytest.mark.parametrize(("step", "left"), [(0.0, 1.0), (500.0, 0.5), (1000.0, 0.0), (2000.0, 0.0)])
def test_the_healthy_fraction_is_each_lanes_own_and_decays_to_zero(step, left):
    wanted = np.array([0.0, 0.3, 1.0])
    found = mixed(wanted, 1000.0, step)
    np.testing.assert_allclose(found, left * wanted, atol=4 * 0.5 / BATCH**0.5)
    assert found[0] == 0.0 and (left > 0.0 or not found.any())
    if left == 1.0:
        assert found[2] == 1.0
