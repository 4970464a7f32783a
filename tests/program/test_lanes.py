"""The lane table, its layout over devices, and the independence of the lanes' keys."""

import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.config import Config
from srl_jax.job import plan
from srl_jax.program import lanes, randomness
from srl_jax.program.lanes import Lane

SEEDS, DAMAGES = (0, 1, 5), ("healthy", "leg_rm")


def table(config=None, seeds=SEEDS, algos=("ddpg", "srl"), damages=DAMAGES):
    return plan.table(config or Config(), seeds, algos, damages)


def bits(lane: Lane, stream: str = "act") -> tuple[int, ...]:
    return tuple(jax.random.key_data(randomness.lane_keys([lane], stream))[0].tolist())


def test_table_numbers_algorithms_then_damages_then_seeds():
    rows = table()
    assert [lane.index for lane in rows] == list(range(12))
    assert [(r.algo, r.damage, r.seed) for r in rows] == [
        (algo, damage, seed) for algo in ("ddpg", "srl") for damage in DAMAGES for seed in SEEDS
    ]
    assert {lane.task for lane in rows} == {"p2p"} and {lane.label for lane in rows} == {""}


def test_swept_values_add_lanes():
    sweep = SRLConfig(beta=(0.5, 0.6, 0.7), actor_lr=(1e-3, 1e-4))
    rows = table(dataclasses.replace(Config(), srl=sweep))
    assert [lane.index for lane in rows] == list(range(6 + 6 * 6))
    own = [lane for lane in rows if lane.algo == "srl"]
    assert len({lane.variant for lane in own}) == 6 and len(set(own)) == 36
    assert own[0].label == "actor_lr=0.001 beta=0.5" and own[-1].label == "actor_lr=0.0001 beta=0.7"
    # One variant's lanes are together, so a table of results reads block by block.
    assert [lane.variant for lane in own[:6]] == [own[0].variant] * 6


def test_sweeping_one_algorithm_leaves_the_others_alone():
    config = dataclasses.replace(Config(), ddpg=DDPGConfig(tau=(0.1, 0.2)))
    rows = table(config, seeds=(0,), damages=("leg_rm",))
    assert [(lane.algo, lane.label) for lane in rows] == [
        ("ddpg", "tau=0.1"),
        ("ddpg", "tau=0.2"),
        ("srl", ""),
    ]


@pytest.mark.parametrize("devices", [1, 2, 3, 5, 20])
def test_layout_holds_every_lane_once(devices):
    rows = [*table(seeds=(0, 1, 2, 3, 4), damages=("leg_rm",)), Lane(10, "acteach", 0, "p2p", "leg_rm")]
    layout = lanes.lay_out(rows, devices)
    assert len(layout.rows) == len(layout.padding) == devices * sum(count for _, count in layout.counts)
    kept = [lane for lane, pad in zip(layout.rows, layout.padding, strict=True) if not pad]
    assert sorted(lane.index for lane in kept) == list(range(11))
    assert layout.counts == (("ddpg", -(-5 // devices)), ("srl", -(-5 // devices)), ("acteach", 1))


@pytest.mark.parametrize("devices", [1, 2, 3])
def test_every_device_has_the_same_algorithms_in_the_same_rows(devices):
    layout = lanes.lay_out(table(), devices)
    shares = np.array([lane.algo for lane in layout.rows]).reshape(devices, -1)
    for share in shares:
        for algo, rows in layout.slices().items():
            assert set(share[rows]) == {algo}
    joined = [index for rows in layout.slices().values() for index in range(rows.start, rows.stop)]
    assert joined == list(range(sum(count for _, count in layout.counts)))


@pytest.mark.parametrize("devices", [1, 2, 3])
def test_rows_of_an_algorithm_keep_the_order_of_the_table(devices):
    rows = table(seeds=(0, 1, 2, 3, 4), damages=("leg_rm",))
    layout = lanes.lay_out(rows, devices)
    own = [lane.index for lane in layout.of("srl")]
    assert own == [5, 6, 7, 8, 9] + [9] * (len(own) - 5)


def test_padding_repeats_the_last_lane_and_is_marked():
    layout = lanes.lay_out(table(seeds=(0, 1, 2), algos=("ddpg",), damages=("leg_rm",)), 2)
    assert [lane.index for lane in layout.rows] == [0, 1, 2, 2]
    assert layout.padding == (False, False, False, True)
    assert not any(lanes.lay_out(table(), 1).padding)


def test_keys_are_shared_by_algorithms_and_variants_only():
    lane = Lane(0, "srl", 3, "p2p", "leg_rm")
    same = [("index", 9), ("algo", "ddpg"), ("variant", (("beta", 0.5),))]
    other = [("seed", 4), ("task", "x"), ("damage", "leg_rf")]
    for field, value in same:
        assert bits(dataclasses.replace(lane, **{field: value})) == bits(lane)
    for field, value in other:
        assert bits(dataclasses.replace(lane, **{field: value})) != bits(lane)
    assert bits(lane, "act") != bits(lane, "init")


def test_keys_of_a_table_are_distinct_per_condition():
    rows = table(seeds=tuple(range(20)), damages=("healthy", "leg_rm", "tibia_rm"))
    assert len({bits(lane) for lane in rows}) == 60


def test_keys_do_not_depend_on_which_lanes_run_beside():
    def by_name(rows):
        return {(lane.algo, lane.seed, lane.damage): bits(lane) for lane in rows}

    everything, few = by_name(table()), by_name(table(seeds=(5,), algos=("srl",), damages=("leg_rm",)))
    assert few.items() <= everything.items()


def test_keys_are_made_for_many_lanes_at_once_as_for_one():
    rows = table(seeds=tuple(range(7)))
    together = jax.random.key_data(randomness.lane_keys(rows, "act")).tolist()
    assert [tuple(found) for found in together] == [bits(lane) for lane in rows]


def test_streams_of_a_step_differ_from_each_other_and_between_lanes_and_steps():
    keys = randomness.lane_keys(table()[:3], "train")
    found = [randomness.at_step(keys, np.int32(clock), stream) for clock in (0, 10) for stream in randomness.Stream]
    bits_ = np.concatenate([np.asarray(jax.random.key_data(key)) for key in found])
    assert len(np.unique(bits_, axis=0)) == len(bits_)


def test_robots_keys_go_by_their_number():
    keys = randomness.lane_keys(table()[:2], "train")
    all_of_them = jax.random.key_data(randomness.per_robot(keys, 0, 6))
    later = jax.random.key_data(randomness.per_robot(keys, 4, 2))
    np.testing.assert_array_equal(np.asarray(all_of_them)[:, 4:], later)
    assert len(np.unique(np.asarray(all_of_them).reshape(-1, 2), axis=0)) == 12


@pytest.mark.parametrize(("before", "after"), [(2, 1), (1, 2), (2, 3), (3, 3)])
def test_rows_move_to_another_layout_with_their_lanes(before, after):
    rows = table(seeds=(0, 1, 2, 3, 4), damages=("leg_rm",))
    old, new = lanes.lay_out(rows, before), lanes.lay_out(rows, after)
    order = lanes.moved([lane.index for lane in old.rows], new.rows)
    assert [old.rows[place].index for place in order] == [lane.index for lane in new.rows]
    with pytest.raises(ValueError, match="not among those that were stored"):
        lanes.moved([0, 1, 2], new.rows)


def test_thousands_of_lanes_are_laid_out_by_index():
    rows = table(seeds=tuple(range(1024)))
    layout = lanes.lay_out(rows, 2)
    assert sorted(layout.lanes.tolist()) == list(range(4096))
    for algo, places in layout.rows_of.items():
        assert {layout.rows[place].algo for place in places} == {algo}
