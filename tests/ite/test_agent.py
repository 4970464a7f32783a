"""Trial and error as an agent: whose episodes are trials, what a trial changes, and when the search is over."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import ITEConfig
from srl_jax.env import gait
from srl_jax.ite import agent, elites, family
from srl_jax.ite import archive as repertoire
from srl_jax.types import ActState, EndedEpisodes, GuidanceState

FITNESS = (1.0, 2.0, 1.5, 0.5)  # m, of four gaits whose feet are far from each other's


def save_map(path, clock_hz: float) -> None:
    genes = jax.random.randint(jax.random.key(0), (4, 36), 0, elites.LEVELS, jnp.uint8)
    feet = jnp.array([[0.1] * 6, [0.9] * 6, [0.1, 0.9] * 3, [0.9, 0.1] * 3])
    archive = elites.insert(elites.empty(), elites.Batch(jnp.array(FITNESS), genes, feet))
    repertoire.save(path, archive, {"clock_hz": clock_hz})


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> ITEConfig:
    path = tmp_path_factory.mktemp("map") / "map.npz"
    save_map(path, float(gait.load().frequency))
    return ITEConfig(repertoire=str(path), trials=3)


def begin(config: ITEConfig) -> agent.ITEState:
    return agent.init(jax.random.key(0), 5, 18, config=config)


def ended(distance, began=0, now=100, others=9.0) -> EndedEpisodes:
    """Two robots' episodes; only the first is the lane's own."""
    fill = lambda value: jnp.full(2, value)  # noqa: E731
    distances = jnp.array([distance, others])
    return EndedEpisodes(fill(True), jnp.zeros(2, jnp.uint32), distances, distances, fill(began), fill(now))


def test_a_search_begins_with_the_maps_best_gait(config):
    prior, gaits = agent.prior_map(config.repertoire)
    state = begin(config)
    assert prior.fitness[state.cell] == 2.0
    np.testing.assert_array_equal(state.actor["gait"], gaits[state.cell])


def test_a_good_trial_ends_the_search_and_a_bad_one_moves_on(config):
    prior, gaits = agent.prior_map(config.repertoire)
    finish = jax.jit(lambda s, e: agent.finish(s, e, config=config, hyper=from_config(config)))
    first = begin(config)
    good = finish(first, ended(1.95))
    assert good.over and good.trials.count == 1
    same = finish(good, ended(0.1, began=100, now=200))
    assert same.trials.count == 1 and same.cell == good.cell
    bad = finish(first, ended(0.2))
    assert not bad.over and bad.since == 100 and bad.cell != first.cell and prior.fitness[bad.cell] == 1.5
    np.testing.assert_array_equal(bad.gait, gaits[bad.cell])
    stale = finish(bad, ended(1.5, began=99, now=150))
    assert stale.trials.count == 1
    second = finish(bad, ended(0.8, began=100, now=200))
    np.testing.assert_array_equal(second.actor["gait"], gaits[bad.cell])  # the best so far, though not good enough
    third = finish(second, ended(0.1, began=200, now=300))
    assert third.over and third.trials.count == 3
    metrics = agent.gauge(third)
    expected = {"trials": 3, "trial_seconds": 15.0, "trial_gait": int(bad.cell), "trial_best": 0.8, "trial_over": 1}
    assert {name: round(float(value), 5) for name, value in metrics.items()} == expected
    np.testing.assert_array_equal(third.actor["gait"], gaits[bad.cell])


def test_it_walks_by_the_gait_on_trial_and_afterwards_by_the_best(config):
    clock = 0.3
    angle = 2.0 * np.pi * clock
    observation = jnp.array([np.sin(angle), np.cos(angle), 1.0, 0.0, 0.0], jnp.float32)
    state = begin(config)._replace(actor={"gait": jnp.full(36, 0.25)})
    carried = ActState(jnp.zeros(18), GuidanceState(jnp.int32(0), jnp.int32(0)), jnp.uint32(0))
    rest = dict(config=config, hyper=from_config(config), step=jnp.float32(0))
    act = lambda state: agent.act(state, carried, observation, jax.random.key(0), **rest)[0]  # noqa: E731
    np.testing.assert_allclose(act(state), family.action(state.gait, clock), atol=2e-3)
    over = state._replace(over=jnp.array(True))
    np.testing.assert_allclose(act(over), family.action(jnp.full(36, 0.25), clock), atol=2e-3)
    np.testing.assert_allclose(agent.student(state.actor, observation, config=config), act(over))


def test_after_another_damage_the_search_begins_anew_and_robot_time_goes_on(config):
    finish = jax.jit(lambda s, e: agent.finish(s, e, config=config, hyper=from_config(config)))
    over = finish(begin(config), ended(1.95, now=50))
    assert over.over and over.seconds == 2.5
    again = agent.reopen(over, jnp.int32(170), config=config)
    assert not again.over and again.trials.count == 0 and again.since == 170 and again.seconds == 2.5
    np.testing.assert_array_equal(again.actor["gait"], over.actor["gait"])
    assert again.cell == begin(config).cell
    stale = finish(again, ended(0.1, began=169, now=200))
    assert stale.trials.count == 0
    tried = finish(again, ended(0.2, began=170, now=270))
    assert tried.trials.count == 1 and tried.seconds == 7.5


def test_a_map_of_another_clock_is_refused(tmp_path):
    save_map(tmp_path / "slow.npz", 1.0)
    with pytest.raises(ValueError, match="was made with clock_hz=1"):
        agent.prior_map(str(tmp_path / "slow.npz"))
