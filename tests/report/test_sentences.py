"""What a run has shown is told in numbers of its summary."""

import pytest

from srl_jax.report import sentences
from srl_jax.report.data import read_metrics
from tests.report.runs import write


def entry(iqm):
    return {"iqm": iqm, "low": iqm - 0.02, "high": iqm + 0.01}


def summary(key, **methods):
    """A summary that has one entry."""
    return {"methods": {label: {"overall": {key: entry(iqm)}} for label, iqm in methods.items()}}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run of each task, for its name and its methods."""
    folder = tmp_path_factory.mktemp("sentences")
    return {task: read_metrics(write(folder / task, task=task)) for task in ("x", "p2p")}


def test_the_best_method_comes_first(runs):
    found = sentences.lead(runs["x"], summary("retained", ddpg=0.5, srl=0.93))
    assert found == ["SRL keeps .93 [.91, .94] of the healthy robot's speed; DDPG .50 [.48, .51]."]


def test_of_equals_the_one_that_earns_more_comes_first(runs):
    told = summary("success", ddpg=0.0, srl=0.0)
    for label, earned in (("ddpg", 0.1), ("srl", 19.0)):
        told["methods"][label]["overall"]["return"] = entry(earned)
    assert sentences.lead(runs["p2p"], told)[0].startswith("SRL reaches")


def test_the_frozen_policy_and_the_probability_are_told(runs):
    told = summary("success", ddpg=0.5, srl=0.9)
    told["methods"]["srl"]["overall"]["teacher_success"] = entry(0.2)
    pair = {"x": "srl", "y": "ddpg", "score": "area_success", "probability": 0.84, "low": 0.77, "high": 0.91}
    first, second = sentences.lead(runs["p2p"], told | {"improvement": [pair, {**pair, "score": "area_return"}]})
    assert first.endswith("DDPG .50 [.48, .51]; the frozen policy from before the damage .20 [.18, .21].")
    assert second == "By the area under success, SRL is better than DDPG with probability .84 [.77, .91]."
    told = summary("retained", ddpg=0.5, srl=0.9) | {"improvement": [{**pair, "score": "area_return"}]}
    assert sentences.lead(runs["x"], told)[1].startswith("By the area under return, SRL is better")


def test_of_many_methods_some_are_named(runs):
    many = {f"m{n}": n / 10 for n in range(6)}
    (found,) = sentences.lead(runs["p2p"], summary("success", **many))
    assert found.startswith("Of 6 methods m5 reaches") and found.count(";") == sentences.RIVALS and "m1" not in found


@pytest.mark.parametrize(
    ("key", "said"), [("return", "SRL returns .70 [.68, .71] an episode."), ("fell", "Nothing has")]
)
def test_what_old_runs_lack_is_not_needed(runs, key, said):
    assert sentences.lead(runs["x"], summary(key, srl=0.7))[0].startswith(said)


def test_a_method_without_a_number_is_passed_over(runs):
    told = summary("success", srl=0.7)
    told["methods"]["ddpg"] = {"overall": {"success": {"iqm": None, "low": None, "high": None}}}
    assert sentences.lead(runs["p2p"], told) == ["SRL reaches the goal in .70 [.68, .71] of its episodes."]


@pytest.mark.parametrize(("seconds", "said"), [(0.0, "0 s"), (34.7, "34.7 s"), (1383.7, "23.1 min"), (5400.0, "1.5 h")])
def test_times_have_the_unit_that_suits(seconds, said):
    assert sentences.spent(seconds) == said


def test_robot_time_is_at_twenty_hertz():
    assert sentences.duration(50_000) == "41.7 min"
