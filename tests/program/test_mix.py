"""Robots of one lane carry different damages of its mix, drawn anew at every start; without a mix there is no trace."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage as damages
from srl_jax.job import checkpoint, plan, start
from srl_jax.job.teachers import scripted_gait
from srl_jax.program import engine as engines
from srl_jax.program import strides
from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine
from srl_jax.program.lanes import MIX as NAME
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import TRAIN, on_rows
from tests.conftest import DEVICES
from tests.program.mixed import MIX, K, config
from tests.program.rows import assert_same

pytestmark = pytest.mark.slow

E = 4
READING = slice(4, 25)  # of an onboard observation: gravity and joint angles
JOINTS = slice(7, 25)


@pytest.fixture(scope="module")
def own():
    """The engine, its rows, and () -> a state at step 0."""
    lanes, teachers = plan.make(config()).lanes, (scripted_gait(),)
    engine = Engine(start.make_program(config(), lay_out(lanes, DEVICES), teachers))
    data = start.make_lanes(engine.program, config(), teachers, "train", [NAME] * len(lanes))
    state = start.init_state(engine, data)
    return engine, data, lambda: jax.tree.map(jnp.copy, state)


def walked(own, steps, state=None, data=None):
    engine, its_data, fresh = own
    state, tally = state or (fresh(), tallies.empty(engine.program))
    return engine.chunk(state, tally, data or its_data, TRAIN(), steps)


def silent(world):
    """Which joints no robot's encoder answers for, bool[R, E, 18]."""
    return np.asarray(world.observation)[..., JOINTS] == 0.0


def lost(drawn):
    """Which joints are missing by what robots have drawn."""
    return np.stack([~np.asarray(damages.present(damages.build(name))) for name in MIX])[np.asarray(drawn)]


def test_every_robot_draws_of_the_mix_and_each_damage_comes_up(own):
    engine, data, _ = own
    drawn = np.concatenate([engine.new_world(data, first).drawn for first in range(0, 200, E)], axis=1)
    shares = np.stack([np.bincount(row, minlength=len(MIX)) for row in drawn]) / drawn.shape[1]
    assert shares.shape == (2, len(MIX)), "nothing else was drawn"
    assert np.all(np.abs(shares - 1 / 3) < 0.12) and not np.array_equal(*drawn), "each lane draws for itself"
    again = np.asarray(engine.new_world(data, 2).drawn)
    np.testing.assert_array_equal(again, drawn[:, 2 : 2 + E]), "an episode's damage depends on its number alone"


def test_a_robot_feels_what_it_has_drawn_until_its_episode_ends(own):
    before = own[2]().world
    np.testing.assert_array_equal(silent(before), lost(before.drawn))
    assert len(np.unique(before.drawn)) > 1
    state, _ = walked(own, 5)
    going = np.asarray(state.world.env.steps) == 5  # who fell has begun anew
    assert going.sum() >= 4
    np.testing.assert_array_equal(np.asarray(state.world.drawn)[going], np.asarray(before.drawn)[going])
    np.testing.assert_array_equal(silent(state.world), lost(state.world.drawn))
    state, tally = walked(own, 30)
    np.testing.assert_array_equal(silent(state.world), lost(state.world.drawn))
    assert not np.array_equal(state.world.drawn, before.drawn) and np.all(np.asarray(tally.episodes) >= 20)
    assert np.all(np.asarray(state.alive))


def test_it_moves_as_the_damage_that_it_has_drawn(own):
    engine, data, fresh = own
    program, steps = engine.program, 2

    def moved(its_data, number):
        drawn = jnp.full((2, E), number, jnp.int32)
        state = fresh()
        state = state._replace(world=on_rows(program, state.world._replace(drawn=drawn)))
        world = walked(own, steps, (state, tallies.empty(program)), its_data)[0].world
        return np.where((np.asarray(world.env.steps) == steps)[..., None], world.env.qpos, np.nan)  # fallen: begun anew

    found = [moved(data, number) for number in range(len(MIX))]
    for name, own_way in zip(MIX, found, strict=True):
        assert np.isfinite(own_way).all(-1).sum() >= 4
        alone = moved(engines.with_damage(program, data, [name] * 2), 0)
        np.testing.assert_array_equal(own_way, alone)
    assert np.nanmax(np.abs(found[0] - found[2])) > 1e-3


def test_rows_of_one_damage_have_it_whatever_is_drawn(own):
    engine, data, _ = own
    healthy = engines.with_damage(engine.program, data, ["healthy"] * 2)
    world = engine.new_world(healthy)
    assert not silent(world).any() and len(np.unique(world.drawn)) > 1
    plain = engines.damage_rows(["leg_rf", "healthy"])
    mixed = engines.damage_rows([NAME, "healthy"], MIX)
    for one, many in zip(plain, mixed, strict=True):
        assert many.shape == (2, len(MIX), *one.shape[1:])
        np.testing.assert_array_equal(many[0, 0], one[0])
        np.testing.assert_array_equal(many[1], np.stack([one[1]] * len(MIX)))


def test_who_starts_in_mid_stride_is_one_of_its_own_damages(own):
    engine, data, _ = own
    world, starts = jax.device_get((engine.new_world(data, 0), data.starts))
    assert starts.qpos.shape[:3] == (2, len(MIX), strides.COUNT)
    walking = np.abs(world.env.qvel).max(-1) > 0.0
    assert 0 < walking.sum() < walking.size
    for row, robot in np.argwhere(walking):
        among = starts.qpos[row, world.drawn[row, robot]]
        assert np.any(np.all(among == world.env.qpos[row, robot], axis=-1))
        assert np.any(world.env.history[row, robot] != 0.0), "it remembers how it walked"
    assert not np.any(world.env.history[~walking])


def test_observations_end_with_the_transitions_before(own):
    state, _ = walked(own, 6)
    stored = start.first_steps(own[0].program, "srl", state, 6 * E)
    seen = np.asarray(stored.observation).reshape(2, 6, E, -1)
    done, reached = (np.asarray(x).reshape(2, 6, E, -1) for x in (stored.action, stored.next_observation))
    going = np.asarray(stored.discount).reshape(2, 6, E) > 0.0
    last = np.concatenate([seen[..., READING], done], axis=-1)  # replays keep half precision
    np.testing.assert_allclose(reached[going][:, -39:], last[going], atol=2e-3)
    np.testing.assert_array_equal(reached[going][:, 25:-39], seen[going][:, 25 + 39 :])
    assert seen.shape[-1] == 25 + K * 39


def test_it_goes_on_from_a_checkpoint_to_the_same_bits(own, tmp_path):
    engine, data, fresh = own
    state, tally = walked(own, 9)
    with checkpoint.manager(tmp_path) as keeper:
        checkpoint.save(keeper, engine.program, state, data, tally, {}, last=True)
        found = checkpoint.restore(keeper, engine.program, fresh(), data, tallies.empty(engine.program))
    assert found is not None
    back, its_data, its_tally, _ = found
    assert_same(jax.device_get(back.world), jax.device_get(state.world))
    on = walked(own, 7, (back, its_tally), its_data)
    assert_same(jax.device_get(on[0].world), jax.device_get(walked(own, 7, (state, tally))[0].world))


def test_without_a_mix_nothing_is_drawn_and_nothing_is_carried(engine, data, fresh):
    world = fresh().world
    assert engine.program.mix == () and world.drawn is None and world.env.history is None
    assert data.damage.body_mass.shape == (12, 20)
    assert engine.new_world(data).drawn is None
