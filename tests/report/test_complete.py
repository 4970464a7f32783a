"""What can stand in a table while lanes are missing."""

import pytest

from srl_jax.report.complete import complete
from srl_jax.report.data import read_metrics
from srl_jax.sweep.merge import copy
from tests.sweep import packs


@pytest.fixture
def run(tmp_path):
    """A run of two methods, three seeds and two damages, of which packs may be left out."""
    sweep = packs.planned(tmp_path / "s", 2)  # six packs, each one DDPG and one SRL lane

    def read(*numbers):
        for number in numbers:
            packs.finish(sweep, number)
        (tmp_path / "joined").mkdir()
        copy(sweep, numbers, tmp_path / "joined")
        return read_metrics(tmp_path / "joined")

    return read


def names(run):
    return sorted((lane["algo"], lane["damage"], lane["seed"]) for lane in run.lanes)


def test_a_whole_run_stays_as_it_is(run):
    whole = run(0, 1, 2, 3, 4, 5)
    assert complete(whole) == (whole, [])


def test_the_larger_rectangle_stays(run):
    part, said = complete(run(0, 1, 2, 3, 4))  # leg_lf, the second, lacks seed 2
    assert names(part) == [(a, d, s) for a in ("ddpg", "srl") for d in ("leg_lf", "leg_rm") for s in (0, 1)]
    assert said == [f"{algo}: 4 of the 5 lanes that there are fill a table." for algo in ("ddpg", "srl")]
    assert part.last("eval/return") == {lane["lane"]: lane["lane"] + 1.6 for lane in part.lanes}
    assert part.metrics["eval/return"].values.shape[1] == len(part.lanes) == len(part.columns)


def test_damages_stay_where_they_keep_more(run):
    part, _ = complete(run(0, 1, 2, 3))
    assert names(part) == [(a, "leg_rm", s) for a in ("ddpg", "srl") for s in range(3)]


def test_a_method_of_which_nothing_stays_is_left_out(run):
    part, said = complete(run(0, 4))
    assert part.lanes == [] and len(said) == 2
