"""The episodic search: what an episode draws, which episodes count, and that every estimator climbs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from srl_jax.agents import search
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import SearchConfig
from srl_jax.types import ActState, EndedEpisodes, GuidanceState

SIZE, M = 3, 12
TARGET = jnp.array([0.3, -0.2, 0.1])


def gait(params, observation):
    """A policy of three parameters in two leaves."""
    return observation * params["gain"] + jnp.concatenate([params["bias"], jnp.zeros(1)])


TEACHER = Partial(gait, {"gain": jnp.float32(2.0), "bias": jnp.array([0.1, 0.2])})
KEY, OBSERVATION = jax.random.key(0), jnp.array([1.0, -1.0, 0.5])
CONFIG = SearchConfig(trajectories=M, search_rate=(0.3,), spread=(0.1,))


def begin(config: SearchConfig = CONFIG) -> search.SearchState:
    return search.init(KEY, 3, 3, config=config, teachers=(TEACHER,))


def episodes(returns, began=0, now=10, ended=True, first=0) -> EndedEpisodes:
    count = len(returns)
    fill = lambda value: jnp.full(count, value)  # noqa: E731
    seeds = jnp.arange(first, first + count, dtype=jnp.uint32)
    return EndedEpisodes(
        fill(ended), seeds, jnp.asarray(returns, jnp.float32), jnp.zeros(count), fill(began), fill(now)
    )


def finish(state, seen, config=CONFIG, **values):
    return search.finish(state, seen, config=config, hyper=from_config(config, **values))


def test_an_untrained_student_is_the_teacher_and_an_offset_moves_its_parameters():
    state = begin()
    student = lambda offset: search.student({"offset": offset}, OBSERVATION, config=CONFIG, teachers=(TEACHER,))  # noqa: E731
    np.testing.assert_allclose(student(state.actor["offset"]), gait(*TEACHER.args, OBSERVATION))
    moved = {"bias": jnp.array([0.2, 0.0]), "gain": jnp.float32(3.0)}  # leaves in the order of their names
    np.testing.assert_allclose(student(jnp.array([0.1, -0.2, 1.0])), gait(moved, OBSERVATION), atol=1e-6)


def test_a_robot_walks_by_one_draw_for_the_whole_episode():
    def act(seed, key):
        guidance = GuidanceState(jnp.int32(0), jnp.int32(0))
        carried = ActState(jnp.zeros(3), guidance, jnp.uint32(seed))
        rest = dict(config=CONFIG, hyper=from_config(CONFIG), step=jnp.float32(0), teachers=(TEACHER,))
        return search.act(begin(), carried, OBSERVATION, key, **rest)[0]

    np.testing.assert_array_equal(act(5, KEY), act(5, jax.random.key(9)))
    assert np.abs(np.asarray(act(5, KEY) - act(6, KEY))).max() > 1e-3
    expected = 0.1 * search.draw(jnp.uint32(5), SIZE)
    np.testing.assert_allclose(act(5, KEY), search.moved(TEACHER, expected, OBSERVATION), atol=1e-6)


def test_a_network_is_too_large_to_search():
    with pytest.raises(ValueError, match="behaviour has 101 parameters"):
        search.init(KEY, 3, 3, config=CONFIG, teachers=(Partial(gait, jnp.zeros(101)),))


def test_trajectories_are_kept_until_there_are_enough_and_then_start_anew():
    state = finish(begin(), episodes(np.arange(5.0)))
    assert state.count == 5 and state.since == 0
    np.testing.assert_allclose(state.returns[:5], np.arange(5.0))
    np.testing.assert_allclose(state.draws[3], search.draw(jnp.uint32(3), SIZE))
    nothing = finish(state, episodes(np.ones(5), ended=False))
    np.testing.assert_array_equal(nothing.returns, state.returns)
    assert nothing.count == 5
    full = finish(state, episodes(np.arange(9.0), now=40, first=5))  # two more than there is room for
    assert full.count == 0 and full.since == 40 and np.any(full.actor["offset"] != 0)
    stale = finish(full, episodes(np.ones(4), began=39, now=60))
    assert stale.count == 0
    assert finish(full, episodes(np.ones(4), began=40, now=60)).count == 4


@pytest.mark.parametrize("estimator", ["monte_carlo", "model1", "model2"])
def test_every_estimator_climbs_to_the_best_parameters(estimator):
    config = SearchConfig(trajectories=40, estimator=estimator)
    hyper = from_config(config)

    @jax.jit
    def climb(state, number):
        seeds = (jnp.arange(40) + 40 * number).astype(jnp.uint32)
        z = jax.vmap(lambda seed: search.draw(seed, SIZE))(seeds)
        theta = state.actor["offset"][None] + search.deviation(state, hyper)[None] * z
        returns = 5.0 - jnp.sum(jnp.square(theta - TARGET[None]), axis=1)
        seen = EndedEpisodes(jnp.ones(40, bool), seeds, returns, returns, jnp.full(40, number), jnp.full(40, number))
        return search.finish(state, seen, config=config, hyper=hyper)

    state = begin(config)
    for number in range(40):
        state = climb(state, number)
    np.testing.assert_allclose(state.actor["offset"], TARGET, atol=0.05)
    assert 0.0199 < float(search.deviation(state, hyper).max()) < 0.1  # surer than at the start
    assert state.metrics["gradient_failed"] == 0.0


def test_returns_that_say_nothing_move_nothing():
    state = finish(begin(SearchConfig(trajectories=M, estimator="model2")), episodes(np.full(M, 3.0)))
    np.testing.assert_allclose(state.actor["offset"], 0.0, atol=1e-6)
    assert state.metrics["gradient_failed"] == 0.0
