"""A checkpoint gives back every lane's rows, whatever devices they lay on, and whatever else was kept with them."""

import jax
import numpy as np
import pytest

from srl_jax.job import checkpoint, plan, start
from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import TRAIN

ABOUT = {"metrics": 7, "totals": {"trained": 12}}


def same(left, right):
    jax.tree.map(np.testing.assert_array_equal, *map(_bits, jax.device_get((left, right))))


def _bits(tree):
    is_key = lambda x: jax.numpy.issubdtype(x.dtype, jax.dtypes.prng_key)  # noqa: E731
    return jax.tree.map(lambda x: jax.random.key_data(x) if is_key(x) else x, tree)


def saved(directory, engine, state, data, tally):
    with checkpoint.manager(directory) as keeper:
        checkpoint.save(keeper, engine.program, state, data, tally, ABOUT, last=True)


def restored(directory, engine, state, data):
    with checkpoint.manager(directory) as keeper:
        found = checkpoint.restore(keeper, engine.program, state, data, tallies.empty(engine.program))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def other(engine, tiny, teachers):
    """The same lanes on one device, a program that is never compiled, with a fresh state."""
    lanes = list({lane.index: lane for lane in engine.program.layout.rows}.values())
    one = Engine(start.make_program(tiny, lay_out(lanes, 1), teachers))
    data = start.make_lanes(one.program, tiny, teachers, "train", [lane.damage for lane in one.program.layout.rows])
    return one, data, start.init_state(one, data)


@pytest.mark.slow
def test_a_run_moves_to_other_devices_and_back_without_losing_a_bit(engine, data, fresh, trained, other, tmp_path):
    state, tally = trained(data, 11)
    saved(tmp_path / "two", engine, state, data, tally)
    one, its_data, its_state = other
    moved, moved_data, moved_tally, about = restored(tmp_path / "two", one, its_state, its_data)
    assert about == ABOUT
    for lane in (0, 5, 11):
        here, there = (e.program.layout.lanes.tolist().index(lane) for e in (engine, one))
        same(*(jax.tree.map(lambda x, i=i: x[i], s.world) for s, i in ((state, here), (moved, there))))
    saved(tmp_path / "one", one, moved, moved_data, moved_tally)
    back, back_data, back_tally, _ = restored(tmp_path / "one", engine, fresh(), data)
    same((back, back_tally), (state, tally))
    on = engine.chunk(back, back_tally, back_data, TRAIN(), 9)
    same(on, engine.chunk(state, tally, data, TRAIN(), 9))


def test_what_is_switched_off_leaves_no_trace_so_that_older_checkpoints_fit(trained, data):
    state, tally = trained(data, 1)
    world = checkpoint._payload(state, data, tally, 1)["by_row"]["world"]
    assert {"env", "act", "observation", "episode"} == set(world)
    assert "history" not in world["env"] and {"noise", "guidance", "seed"} == set(world["act"])


def test_networks_are_found_by_lane(engine, data, trained, tmp_path):
    state, tally = trained(data, 11)
    saved(tmp_path, engine, state, data, tally)
    found = checkpoint.networks(tmp_path)
    assert found.keys() == {"ddpg", "srl", "bpg"} and checkpoint.newest(tmp_path) == 22
    layout = engine.program.layout
    for algo in ("srl", "bpg"):
        for row, lane in enumerate(layout.of(algo)):
            stored = jax.tree.map(lambda x, i=found[algo].place[lane.index]: x[i], found[algo].trees["actor"])
            same(stored, jax.tree.map(lambda x, i=row: x[i], state.agents[algo].actor))


def test_lanes_of_another_run_are_refused(engine, tiny, data, trained, teachers, tmp_path):
    state, tally = trained(data, 2)
    saved(tmp_path, engine, state, data, tally)
    lanes = plan.make(tiny).lanes[:1]
    layout = lay_out([lanes[0].__class__(99, "ddpg", 0, "p2p", "leg_rm")], 1)
    stranger = Engine(start.make_program(tiny, layout, teachers))
    its_data = start.make_lanes(stranger.program, tiny, teachers, "train", ["leg_rm"])
    with pytest.raises(ValueError, match="cannot be read"):
        restored(tmp_path, stranger, start.init_state(stranger, its_data), its_data)


def test_a_directory_without_checkpoints_has_none(tmp_path):
    assert checkpoint.newest(tmp_path / "nothing") == 0
    with pytest.raises(ValueError, match="is not a directory of checkpoints"):
        checkpoint.networks(tmp_path / "nothing")
    with pytest.raises(ValueError, match="holds no complete checkpoint"):
        checkpoint.networks(tmp_path)
