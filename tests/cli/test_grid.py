"""Settings combined on the command line."""

import pytest

from srl_jax.cli.grid import combinations
from srl_jax.cli.run import parse


def test_every_combination_is_a_run_of_its_own():
    grid = ("srl.hidden=64,64;32,", "train.update-every=1;2")
    found = {label: parse(words)[1] for label, words in combinations(grid, ["--task", "x"])}
    assert list(found) == [
        "srl.hidden=64,64 train.update-every=1",
        "srl.hidden=64,64 train.update-every=2",
        "srl.hidden=32, train.update-every=1",
        "srl.hidden=32, train.update-every=2",
    ]
    got = [(config.srl.hidden, config.train.update_every, config.task) for config in found.values()]
    assert got == [((64, 64), 1, "x"), ((64, 64), 2, "x"), ((32,), 1, "x"), ((32,), 2, "x")]


def test_without_a_grid_there_is_one():
    assert list(combinations((), ["--seeds", "3"])) == [("", ["--seeds", "3"])]


@pytest.mark.parametrize(
    ("grid", "field", "values"),
    [
        ("task=x;xy", lambda c: c.task, ["x", "xy"]),
        ("srl.commit=true;false", lambda c: c.srl.commit, [True, False]),
        ("srl.guidance-weight=1,4;10", lambda c: c.srl.guidance_weight, [(1.0, 4.0), (10.0,)]),
        ("algos=ddpg;srl", lambda c: c.algos, ["ddpg", "srl"]),
    ],
)
def test_values_of_every_kind(grid, field, values):
    assert [field(parse(words)[1]) for _, words in combinations((grid,), [])] == values


@pytest.mark.parametrize("grid", ["srl.hidden", "srl.hidden=", "srl.hidden=64;64", "=1"])
def test_what_is_no_axis(grid):
    with pytest.raises(ValueError, match=r"grid has .*"):
        list(combinations((grid,), []))


@pytest.mark.parametrize("name", ["hidden", "srl.hiden", "sarl.hidden", "srl.hidden.x", "more"])
def test_what_is_no_setting(name):
    with pytest.raises(ValueError, match=rf"grid has '{name}': that is no setting of a run"):
        list(combinations((f"{name}=1;2",), []))


def test_a_setting_that_is_named_twice():
    with pytest.raises(ValueError, match="name each setting once"):
        list(combinations(("task=x", "task=xy"), []))
