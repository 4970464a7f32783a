"""Mini-batches and healthy replay: what an update is fed."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents.hyper import stack
from srl_jax.agents.settings import SRLConfig
from srl_jax.program import learn
from srl_jax.program.learn import mix_prior
from srl_jax.program.settings import TrainConfig
from srl_jax.types import Transition

LANES, BATCH, WIDTH = 3, 400, 5


def filled_with(values, count):
    """Transitions of every lane whose every entry is the lane's value."""
    shapes = ((WIDTH,), (2,), (), (), (WIDTH,), (), ())
    return Transition(*(jnp.ones((LANES, count, *s)) * values.reshape(-1, 1, *(1,) * len(s)) for s in shapes))


def mixed(fractions, decay, step):
    """The share of healthy rows in each lane's mini-batch: own rows are zeros, lane i's healthy ones are i + 1."""
    hyper = stack(SRLConfig(prior_decay=(decay,)), [{"prior_fraction": fraction} for fraction in fractions])
    keys = jax.random.split(jax.random.key(0), LANES)
    own, healthy = filled_with(jnp.zeros(LANES), BATCH), filled_with(jnp.arange(1.0, LANES + 1), 7)
    leaves = mix_prior(own, healthy, keys, hyper, jnp.float32(step))
    rows = np.concatenate([np.asarray(leaf).reshape(LANES, BATCH, -1) for leaf in leaves], axis=-1)
    assert np.all(np.ptp(rows, axis=-1) == 0.0), "transitions are replaced whole"
    for lane, found in enumerate(rows):
        assert set(np.unique(found)) <= {0.0, lane + 1.0}, "a lane's healthy rows are its own"
    return (rows[..., 0] > 0.0).mean(axis=1)


@pytest.mark.parametrize(("step", "left"), [(0.0, 1.0), (500.0, 0.5), (1000.0, 0.0), (2000.0, 0.0)])
def test_the_healthy_fraction_is_each_lanes_own_and_decays_to_zero(step, left):
    wanted = np.array([0.0, 0.3, 1.0])
    found = mixed(wanted, 1000.0, step)
    np.testing.assert_allclose(found, left * wanted, atol=4 * 0.5 / BATCH**0.5)
    assert found[0] == 0.0 and (left > 0.0 or not found.any())
    if left == 1.0:
        assert found[2] == 1.0


@pytest.mark.parametrize(("updates", "numbers"), [(1, 1), (4, 1 + 2 + 3 + 4)])
def test_a_turn_is_as_many_updates_as_asked_each_with_a_number_of_its_own(updates, numbers, monkeypatch):
    def once(program, lanes, state, tally, number=0):
        return state + number + 1, tally + 1

    monkeypatch.setattr(learn, "learn_rows", once)
    program = SimpleNamespace(settings=TrainConfig(updates=updates))
    state, tally = learn.take_turn(program, None, jnp.int32(0), jnp.int32(0))
    assert (int(state), int(tally)) == (numbers, updates)
    assert TrainConfig(updates=updates).steps_an_update == 20 / updates
