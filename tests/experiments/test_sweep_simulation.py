"""The simulated cluster does all of the work once, whatever befalls it, and counts every second of every node."""

import dataclasses
import math

import numpy as np
import pytest

from experiments import sweep_simulation
from experiments.sweep_simulation import DOWN, Arguments, Cluster, pack_seconds

# Packs of 80 lanes of 10,000 steps train for 1,000 s on a node.
FREE = Arguments(
    nodes=7,
    lanes=80 * 30,
    steps=(10_000,),
    step_seconds=0.01,
    pack_lanes=(80,),
    start=0.0,
    cold=0.0,
    warm=0.0,
    save_seconds=0.0,
    bandwidth=math.inf,
    mtbf_hours=math.inf,
    preempted=0.0,
    speed_spread=0.0,
)
COSTLY = dataclasses.replace(Arguments(), nodes=20, lanes=80 * 100, step_seconds=0.01)


def run(asked: Arguments, interval: float = 300.0, seed: int = 0, pack_lanes: int = 80) -> Cluster:
    return Cluster(asked, 10_000, pack_lanes, interval, seed).run()


def wastes(asked: Arguments, interval: float = 300.0, seeds: int = 8) -> float:
    return float(np.mean([run(asked, interval, seed).figures()[1] for seed in range(seeds)]))


@pytest.mark.parametrize("interval", [70.0, 1_000.0, math.inf])
@pytest.mark.parametrize(("nodes", "rounds"), [(1, 30), (7, 5), (30, 1), (100, 1)])
def test_without_costs_and_failures_it_is_a_packing(nodes, rounds, interval):
    done = run(dataclasses.replace(FREE, nodes=nodes), interval)
    assert done.now == pytest.approx(rounds * 1_000.0)
    hours, waste, *kinds, restarts, _, _ = done.figures()
    assert hours == pytest.approx(done.now / 3600) and restarts == 0
    assert waste == pytest.approx(100 * (1 - 30 / (nodes * rounds))) and kinds == pytest.approx([0, 0, 0, waste])


def test_costs_lengthen_every_pack_by_themselves():
    asked = dataclasses.replace(FREE, nodes=10, start=20.0, cold=40.0, warm=5.0, save_seconds=0.1)
    done = run(asked, 400.0)  # three rounds, in each of which it saves three times; all wait for the first to compile
    assert done.now == pytest.approx(3 * (20.0 + 1_000.0 + 3 * 8.0) + 40.0 + 3 * 5.0)
    assert done.spent[sweep_simulation.START] == pytest.approx(30 * 25.0 - 5.0 + 10 * 40.0)


def test_lanes_that_do_not_divide_by_the_cores_leave_cores_waiting():
    assert [pack_seconds(FREE, 10_000, lanes) for lanes in (1, 8, 9)] == [100.0, 100.0, 200.0]
    done = run(dataclasses.replace(FREE, nodes=1, lanes=25), pack_lanes=20)  # in packs of 13 and 12
    assert done.sizes == [13, 12] and done.now == pytest.approx(400.0)


@pytest.mark.parametrize(("mtbf", "preempted"), [(1.0, 0.0), (math.inf, 40.0), (0.5, 40.0)])
def test_all_work_is_done_once_however_much_fails(mtbf, preempted):
    asked = dataclasses.replace(COSTLY, mtbf_hours=mtbf, preempted=preempted)
    done = run(asked, 200.0)
    assert done.restarts >= 30 and max(done.left) < 1e-5
    assert done.work == pytest.approx(100 * 1_000.0)
    assert done.kept + done.lost == pytest.approx(done.spent[sweep_simulation.TRAIN])
    assert sum(done.spent) == pytest.approx(20 * done.now)  # no node's second is missing or counted twice
    assert (done.lost > 0.0) == (mtbf < math.inf)  # who is preempted saves
    assert (done.spent[DOWN] > 0.0) == (mtbf < math.inf)
    _, waste, *kinds, _, _, _ = done.figures()
    assert sum(kinds) == pytest.approx(waste)


def test_more_failures_waste_more():
    found = [wastes(dataclasses.replace(COSTLY, mtbf_hours=mtbf)) for mtbf in (math.inf, 1.0, 0.25)]
    assert found == sorted(found) and found[-1] > found[0] + 5.0
    found = [wastes(dataclasses.replace(COSTLY, preempted=share)) for share in (0.0, 40.0, 200.0)]
    assert found == sorted(found) and found[-1] > found[0] + 1.0


def test_who_saves_more_rarely_loses_more_and_saves_less():
    asked = dataclasses.replace(COSTLY, mtbf_hours=1.0)
    several = [[run(asked, interval, seed) for seed in range(6)] for interval in (50.0, 250.0, 1_000.0)]
    lost = [sum(one.lost for one in same) for same in several]
    saving = [sum(one.spent[sweep_simulation.SAVE] for one in same) for same in several]
    assert lost[1] > 2.0 * lost[0] and lost[2] > 1.5 * lost[1]
    assert saving == sorted(saving, reverse=True)


def test_a_node_that_dies_comes_back_and_its_pack_goes_on_elsewhere_after_the_lease():
    done = Cluster(dataclasses.replace(FREE, nodes=2, lanes=80), 10_000, 80, 300.0, 0)
    done.later(700.0, done.fail, done.nodes[0])
    done.run()
    assert done.lost == pytest.approx(100.0)  # since 600 s
    assert done.now == pytest.approx(700.0 + 90.0 + 120.0 + 400.0)
    assert done.nodes[1].pack == 0 and done.restarts == 1


def test_who_is_preempted_saves_and_goes_on_after_the_queue():
    done = Cluster(dataclasses.replace(FREE, nodes=1, lanes=80, start=10.0, warm=5.0), 10_000, 80, 300.0, 0)
    done.later(710.0, done.preempt, done.nodes[0])  # after 700 s of training
    done.run()
    assert done.lost == 0.0 and done.restarts == 1
    assert done.now == pytest.approx(710.0 + 120.0 + 15.0 + 300.0)


def test_the_file_system_is_shared_by_all_who_write():
    # 80 lanes of 1 GB: 8 s alone at 10 GB/s, and ten nodes that come at once are served in 80 s.
    asked = dataclasses.replace(FREE, nodes=10, lanes=800, lane_bytes=1e9, bandwidth=10.0, metrics_bytes=0.0)
    done = run(asked, math.inf)
    assert done.now == pytest.approx(1_080.0)
    assert done.figures()[-2:] == pytest.approx([800 / 1_080.0, 10.0])
    alone = run(dataclasses.replace(asked, save_seconds=1.0, bandwidth=math.inf), math.inf)  # each at 1 GB/s
    assert alone.now == pytest.approx(1_080.0) and alone.figures()[-1] == pytest.approx(10.0)
    metrics = run(dataclasses.replace(asked, save_seconds=1.0, metrics_bytes=100.0), math.inf).figures()
    assert metrics[-2] == pytest.approx(0.8008 / 1_080.0 * 1_000)  # 100 bytes x 8 million steps are 0.8 GB more


def test_a_seed_says_everything():
    asked = dataclasses.replace(COSTLY, mtbf_hours=2.0)
    first, again, other = (run(asked, seed=seed).figures() for seed in (0, 0, 1))
    assert first == again and first != other


def test_it_prints_a_table_and_names_the_best(capsys):
    asked = dataclasses.replace(COSTLY, steps=(10_000,), pack_lanes=(8, 80, 800), seeds=2)
    sweep_simulation.main(asked)
    said = " ".join(capsys.readouterr().out.split())
    assert "8,000 lanes of 10,000 steps" in said and "80 0.28 3,600" not in said  # where no pack is so long
    assert "80 0.28 inf" in said and "800 2.78 1,800" in said
    # Ten packs on twenty nodes leave half of them idle; with short packs starts cost a quarter.
    assert "packs of 0.28 hours, saved every" in said and "waste least" in said
    assert "packs of 0.28 to 0.28 hours waste at most 1% of all time more" in said
    assert f"1.39 h of nothing but training, says {math.sqrt(2 * 33 * 5_000) / 3600:.2f} hours" in said


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"nodes": 0}, "nodes is 0: give numbers of at least 1"),
        ({"pack_lanes": (8, 0)}, r"pack_lanes is \(8, 0\): give numbers of at least 1"),
        ({"pack_lanes": ()}, r"pack_lanes is \(\): give"),
        ({"intervals": (0.0,)}, r"intervals is \(0.0,\): give numbers above 0"),
        ({"bandwidth": -1.0}, "bandwidth is -1.0: give numbers above 0"),
        ({"mtbf_hours": math.nan}, "mtbf_hours is nan"),
        ({"start": math.inf}, "start is inf: give a number from 0 on"),
        ({"preempted": -0.1}, "preempted is -0.1: give a number from 0 on"),
        ({"mtbf_hours": 0.01}, r"mtbf_hours is 0.01: packs would never end; at least 0\.\d+ is accepted"),
    ],
)
def test_bad_input_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        sweep_simulation.main(dataclasses.replace(Arguments(), **settings))
