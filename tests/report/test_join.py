"""Runs that are comparable become one, and others are refused by the names of what differs."""

import dataclasses
import json

import numpy as np
import pytest

from srl_jax.agents.registry import SHIPPED
from srl_jax.config import Config
from srl_jax.report.data import read_metrics
from srl_jax.report.join import SHARED, check, join
from srl_jax.report.summary import summarise
from tests.report.runs import CONFIG, write

SECTIONS = {"algos": "", "memory_gb": 16.0, "devices": "auto", "srl": {"beta": [0.5]}, "ddpg": {"tau": [0.01]}}
DDPG, SRL = {("ddpg", ""): 0.2}, {("srl", ""): 0.6}


def settings(**changed):
    """The settings of a run, with other values in places."""
    return json.loads(json.dumps(CONFIG | SECTIONS | changed))


@pytest.fixture
def apart(tmp_path):
    """SRL and DDPG from two runs, which differ in what may differ."""
    one = write(tmp_path / "srl", methods=SRL, config=settings(algos="srl", ddpg={"tau": [0.5]}))
    free = settings(algos="ddpg", memory_gb=4.0, devices="2", srl={"beta": [0.1]})
    return one, write(tmp_path / "ddpg", methods=DDPG, config=free)


def test_methods_trained_apart_stand_in_one_table(apart, tmp_path):
    join(apart, tmp_path / "joint")
    joint = read_metrics(tmp_path / "joint")
    assert [lane["lane"] for lane in joint.lanes] == list(range(24))
    for path, algo in zip(apart, ("srl", "ddpg"), strict=True):
        single = read_metrics(path)
        np.testing.assert_array_equal(
            joint.series("eval/return", algo).values, single.series("eval/return", algo).values
        )
        assert summarise(joint, 50)["methods"][algo] == summarise(single, 50)["methods"][algo]
    config = joint.config
    assert (config["algos"], config["srl"], config["ddpg"]) == ("srl,ddpg", {"beta": [0.5]}, {"tau": [0.01]})


def test_the_parts_of_one_run_keep_their_lane_numbers(tmp_path):
    parts = [write(tmp_path / "b", methods=SRL, first=12), write(tmp_path / "a", methods=DDPG)]
    join(parts, tmp_path / "joint")
    join_again = write(tmp_path / "whole", methods=DDPG | SRL)
    joint, whole = read_metrics(tmp_path / "joint"), read_metrics(join_again)
    assert [lane["lane"] for lane in joint.lanes] == [*range(12, 24), *range(12)]
    assert joint.last("eval/return") == whole.last("eval/return")


def test_a_line_that_was_half_written_is_left_out(apart, tmp_path):
    with (apart[0] / "metrics.csv").open("a") as file:
        file.write("300,0,eval/success,0.")
    join(apart, tmp_path / "joint")
    assert read_metrics(tmp_path / "joint").last("eval/success")[0] == read_metrics(apart[0]).last("eval/success")[0]


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"steps": 400}, "steps"),
        ({"env": {"episode_steps": 50}}, r"env\.episode_steps"),
        ({"evaluation": {"episodes": 4}}, r"evaluation\.episodes"),
        ({"behaviour": "train"}, "behaviour"),
        ({"steps": 400, "train": {"environments": 4, "warmup": 9}}, r"steps, train\.warmup"),
    ],
)
def test_runs_that_differ_are_refused_by_name(apart, tmp_path, changed, named):
    other = write(tmp_path / "other", methods=DDPG, config=settings(**changed))
    for directories in ((apart[0], other), (other, apart[0])):
        with pytest.raises(ValueError, match=rf"differs from .* in {named}: no fair table"):
            check(directories)
    with pytest.raises(ValueError, match="no fair table"):
        join((apart[0], other), tmp_path / "joint")
    assert not (tmp_path / "joint").exists()


def test_settings_of_an_algorithm_that_both_have_are_compared(apart, tmp_path):
    methods = {("srl", "beta=0.3"): 0.6} | DDPG
    both = write(tmp_path / "both", methods=methods, seeds=(8, 9), config=settings(srl={"beta": [0.3]}))
    with pytest.raises(ValueError, match=r"in srl\.beta: no fair"):
        check((apart[0], both))
    check((apart[1], both))  # the first has no lanes of srl, and the same settings of ddpg


def test_algorithms_from_outside_the_package_are_compared_as_its_own(apart, tmp_path):
    toy = lambda speed: settings(more={"toy": {"speed": [speed]}})  # noqa: E731
    one = write(tmp_path / "one", methods={("toy", ""): 0.5}, config=toy(1.0))
    other = write(tmp_path / "other", methods={("toy", ""): 0.5}, seeds=(8, 9), config=toy(2.0))
    with pytest.raises(ValueError, match=r"in toy\.speed: no fair"):
        check((one, other))
    join((apart[0], one), tmp_path / "joint")
    assert read_metrics(tmp_path / "joint").config["more"] == {"toy": {"speed": [1.0]}}


def test_a_run_that_says_nothing_of_episodes_had_one_per_environment(apart, tmp_path):
    old = {name: value for name, value in settings().items() if name != "evaluation"}
    four = write(tmp_path / "four", methods=DDPG, config=old)
    with pytest.raises(ValueError, match=r"in evaluation\.episodes"):
        check((apart[0], four))
    check((apart[0], write(tmp_path / "ten", methods=DDPG, config=old | {"train": {"environments": 4}} | CONFIG)))
    ten = old | {"train": {"environments": 10}}
    with pytest.raises(ValueError, match=r"in train\.environments: no fair"):
        check((apart[0], write(tmp_path / "other", methods=DDPG, config=ten)))


def test_the_same_lane_twice_is_refused(apart, tmp_path):
    with pytest.raises(ValueError, match="both have the lane srl 3 p2p leg 0: give one of them"):
        check((apart[0], apart[0]))


def test_every_section_of_a_run_is_shared_or_an_algorithms():
    sections = {name for name, value in vars(Config()).items() if dataclasses.is_dataclass(value)}
    assert sections == {*SHARED, *SHIPPED}


def test_no_run_at_all_is_refused():
    with pytest.raises(ValueError, match="no run is given"):
        check([])


def test_joining_never_writes_over_a_run(apart):
    with pytest.raises(ValueError, match="already holds a run"):
        join(apart, apart[0])
    read_metrics(apart[0])
