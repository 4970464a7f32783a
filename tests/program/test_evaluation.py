"""Evaluations: so many episodes from fixed starts, whatever trains; an explosion counts; training is left alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.program import engine as engines
from srl_jax.program import evaluation
from srl_jax.program import tally as tallies
from srl_jax.program.state import STUDENT, TEACHER, on_rows
from tests.program.rows import assert_same, row

ROWS = 12


@pytest.fixture(scope="module")
def measured(engine, data, fresh):
    """(episodes, state, mode, advance) -> the state, the tally and the finite lanes of an evaluation."""

    def evaluate(episodes, state=None, mode=TEACHER, advance=None):
        state = fresh() if state is None else state
        return evaluation.evaluate(engine, state, data, mode(), episodes, advance=advance)

    return evaluate


@pytest.mark.slow
def test_it_counts_the_episodes_that_were_asked_for(measured):
    for episodes in (1, 2, 3, 5):
        _, tally, finite = measured(episodes)
        assert np.all(np.asarray(tally.episodes) == episodes) and finite.all()


def test_the_ith_episode_does_not_depend_on_how_many_there_are(engine, data, measured):
    """Rounds have two robots: what each further episode adds to the sum is its own."""
    sums = [np.zeros(ROWS), *(np.asarray(measured(n)[1].totals["return"], np.float64) for n in (1, 2, 3, 4))]
    assert np.ptp(np.diff(sums, axis=0), axis=0).min() > 1e-3, "every episode starts otherwise"
    first, second, odd = (np.asarray(engine.new_world(data, first=n).env.qpos) for n in (0, 2, 3))
    assert not np.array_equal(first[:, 0], second[:, 0])
    np.testing.assert_array_equal(odd[:, 0], second[:, 1])


def test_training_goes_on_as_if_nothing_had_been_measured(trained, data, measured):
    state, _ = trained(data, 9)
    before = jax.device_get(state)
    state, _, _ = measured(3, state, STUDENT)
    assert_same(jax.device_get(state), before)


def test_a_lane_that_explodes_is_not_scored_over_the_robots_that_finished_first(engine, measured):
    """A robot's speed is infinite in the second round: those of the first have finished, and must not speak for it."""
    sick, rounds = 1, []

    def advance(state, tally, lanes, mode, steps):
        if rounds:
            env = state.world.env
            qvel = env.qvel.at[sick, 0, 0].set(jnp.inf)
            state = state._replace(world=on_rows(engine.program, state.world._replace(env=env._replace(qvel=qvel))))
        rounds.append(steps)
        return engine.chunk(state, tally, lanes, mode, steps)

    state, tally, finite = measured(4, advance=advance)
    assert np.flatnonzero(~finite).tolist() == [sick]
    assert float(tally.episodes[sick]) == 2.0, "its first round did finish"
    assert np.asarray(state.alive).all(), "it goes on training"


def test_a_lane_that_was_frozen_in_training_stays_frozen(engine, fresh, measured):
    alive = np.ones(ROWS, bool)
    alive[3] = False
    state, _, finite = measured(2, fresh()._replace(alive=on_rows(engine.program, alive)))
    np.testing.assert_array_equal(finite, alive)
    np.testing.assert_array_equal(np.asarray(state.alive), alive)


def test_starts_do_not_depend_on_the_stream_of_training(engine, data):
    fixed = engines.with_stream(engine.program, data, "evaluate")
    once, again = (engine.new_world(fixed).observation for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(row(engine.new_world(data).observation, 0), row(once, 0))


def test_means_are_sums_over_counts_and_nan_of_nothing(engine, data, trained):
    _, tally = trained(data, 12)
    found = tallies.means(engine.program, tally, training=True)
    episodes = np.asarray(tally.episodes)
    expected = np.asarray(tally.totals["return"], np.float64) / episodes
    np.testing.assert_allclose(found["return"].values, expected)
    layout = engine.program.layout
    assert found["p_guid"].rows.tolist() == layout.rows_of["srl"].tolist()
    both = sorted([*layout.rows_of["ddpg"], *layout.rows_of["srl"]])
    assert sorted(found["critic_loss"].rows) == both
    nothing = tallies.means(engine.program, tallies.empty(engine.program), training=True)
    assert all(np.isnan(x.values).all() for x in nothing.values())
