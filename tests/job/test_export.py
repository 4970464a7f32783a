"""What a run has learned leaves it as policies that act alike."""

import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.env import interface
from srl_jax.env.hexapod import observation_size
from srl_jax.env.settings import EnvConfig
from srl_jax.job import export, students
from tests.job.untrained import write


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    directory = tmp_path_factory.mktemp("export") / "run"
    write(dataclasses.replace(preset("smoke"), damage="leg_rm,leg_lf", algos="tripod,ddpg,srl"), directory)
    return directory


def test_every_student_that_is_a_network_acts_alike(finished):
    run = students.open_run(finished)
    policies = export.from_run(finished)
    lanes = [*run.lanes_of("ddpg"), *run.lanes_of("srl")]
    seen = np.random.default_rng(0).normal(size=(9, run.program.observation_size)).astype(np.float32)
    assert len(policies) == len(lanes) == 8
    for own, lane in zip(policies, lanes, strict=True):
        assert (own.about["algo"], own.about["damage"], own.about["seed"]) == (lane.algo, run.damage(lane), lane.seed)
        np.testing.assert_allclose(own(seen), np.asarray(jax.vmap(run.policy(lane))(seen)), atol=1e-5)


def test_it_says_what_the_policy_needs(finished):
    about = export.from_run(finished, seed=1, algos=("srl",))[0].about
    assert about["task"] == "p2p" and about["kind"] == "full" and len(about["action_scale"]) == 18
    assert about["observation"][2] == ("distance, m, at most 2", 1) and "srl" in about["command"]


@pytest.mark.parametrize("task", ["x", "p2p"])
@pytest.mark.parametrize("kind", ["onboard", "rates", "full"])
@pytest.mark.parametrize("history", [0, 3])
def test_the_layout_counts_as_the_observation_does(task, kind, history):
    told = sum(size for _, size in interface.layout(task, kind, history))
    assert told == observation_size(task, EnvConfig(observation=kind, history=history))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"seed": 9}, "seed is 9: .* has 0, 1"),
        ({"algos": ("tripod",)}, "algo is 'tripod', which learns no network: export ddpg, srl"),
        ({"algos": ("ite",)}, "algo is 'ite': .* has tripod, ddpg, srl"),
    ],
)
def test_what_is_not_there_is_refused(finished, asked, message):
    with pytest.raises(ValueError, match=message):
        export.from_run(finished, **asked)
