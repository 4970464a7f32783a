"""Whole adaptations of toy robots with known ends, against their trials taken one by one."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.ite import adaptation, trials
from srl_jax.ite.trials import GaitMap, ProcessSettings

KEY = jax.random.key(0)
RNG = np.random.default_rng(0)
CELLS, CAPACITY = 300, 8
LOST = 0  # the foot of a damage that takes a few trials
PRIOR = trials.make_map(RNG.uniform(size=(CELLS, 6)), RNG.uniform(0.0, 0.4, CELLS))

suggest = jax.jit(trials.suggest)
stopped = jax.jit(trials.stopped)


def robot(damage: jax.Array, index: jax.Array, key: jax.Array) -> jax.Array:
    """A toy: gaits that lean on foot `damage` hardly move it, others do. 6: healthy, 7: does not move."""
    leans = PRIOR.descriptors[index, jnp.minimum(damage, 5)] > 0.35
    kept = jnp.where(damage == 6, 1.0, jnp.where(damage == 7, 0.0, jnp.where(leans, 0.1, 0.9)))
    return kept * PRIOR.fitness[index] + 0.003 * jax.random.normal(key)


@jax.jit
def search(prior: GaitMap, damage: jax.Array, key: jax.Array) -> adaptation.Adaptation:
    return adaptation.adapt(prior, partial(robot, damage), key, trials=CAPACITY, seconds=2.0)


def test_empty_cells_are_never_tried():
    holes = PRIOR._replace(fitness=jnp.where(jnp.arange(CELLS) % 3 > 0, -jnp.inf, PRIOR.fitness))
    found = search(holes, jnp.int32(7), KEY)
    assert found.trials == CAPACITY and np.all(found.index % 3 == 0)
    assert len(set(np.asarray(found.index).tolist())) == CAPACITY


def test_a_healthy_robot_needs_one_trial_and_repeats_it():
    found = search(PRIOR, jnp.int32(6), KEY)
    assert found.trials == 1 and found.seconds == 2.0
    assert found.choice == np.argmax(PRIOR.fitness)
    assert float(found.best) == pytest.approx(float(PRIOR.fitness.max()), abs=0.015)
    np.testing.assert_array_equal(found.stopped, True)
    np.testing.assert_array_equal(found.index, found.choice)
    np.testing.assert_array_equal(found.speed, found.best)


def test_search_equals_its_steps_taken_one_by_one():
    damage = jnp.int32(LOST)
    found = search(PRIOR, damage, KEY)
    state, over = trials.init(CAPACITY), []
    while state.count < CAPACITY and not (over and over[-1]):
        index = suggest(PRIOR, state, ProcessSettings())
        state = trials.record(state, index, robot(damage, index, jax.random.fold_in(KEY, state.count)))
        over.append(bool(stopped(PRIOR, state, ProcessSettings())))
    made = int(state.count)
    assert 2 <= made < CAPACITY and over[-1], "the case has a search in it, and an end"
    np.testing.assert_array_equal(found.index[:made], state.index[:made])
    np.testing.assert_allclose(found.speed[:made], state.observed[:made], rtol=1e-5)
    np.testing.assert_array_equal(found.stopped, over + [True] * (CAPACITY - made))
    assert (found.choice, found.trials, found.seconds) == (trials.best(state)[0], made, 2.0 * made)
    np.testing.assert_array_equal(found.index[made:], found.choice)
    assert found.best == found.speed.max() == found.speed[made]


def test_damages_under_vmap_equal_separate_searches_traced_once():
    traced = []

    def evaluate(damage, index, key):
        traced.append(index)
        return robot(damage, index, key)

    one = lambda damage, key: adaptation.adapt(  # noqa: E731
        PRIOR, partial(evaluate, damage), key, trials=CAPACITY, seconds=2.0
    )
    damages, keys = jnp.array([6, LOST, 7]), jax.random.split(KEY, 3)
    wide = jax.jit(jax.vmap(one))(damages, keys)
    assert len(traced) == 1
    for lane in range(3):
        own = search(PRIOR, damages[lane], keys[lane])
        jax.tree.map(lambda a, b, i=lane: np.testing.assert_allclose(a, b[i], rtol=1e-4, atol=1e-6), own, wide)
    assert len(set(np.asarray(wide.trials).tolist())) == 3, "robots stop at different times"


def test_the_budget_ends_a_search_and_does_not_change_its_beginning():
    stuck = partial(robot, jnp.int32(7))
    short, long = jax.jit(lambda: adaptation.adapt(PRIOR, stuck, KEY, trials=3))(), search(PRIOR, jnp.int32(7), KEY)
    assert not short.stopped.any() and short.trials == 3 and short.seconds == 15.0
    np.testing.assert_array_equal(short.index, long.index[:3])
    np.testing.assert_allclose(short.speed, long.speed[:3], rtol=1e-5)
    assert short.best == short.speed.max()


@pytest.mark.parametrize(("changed", "message"), [({"trials": -1}, "trials is -1"), ({"bonus": "sigma"}, "'sigma'")])
def test_bad_input_is_named(changed, message):
    with pytest.raises(ValueError, match=message):
        adaptation.adapt(PRIOR, lambda index, key: jnp.float32(0), KEY, **changed)
