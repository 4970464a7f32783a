"""Bad configurations get one sentence that names field, value and what is accepted; good ones the right lanes."""

import dataclasses

import pytest

from srl_jax.agents.settings import SRLConfig
from srl_jax.config import preset
from srl_jax.job import plan
from srl_jax.program.settings import TrainConfig


def config(**changes):
    return dataclasses.replace(preset("default"), **changes)


def test_default_plan_is_the_main_job():
    lanes = plan.make(config()).lanes
    assert len(lanes) == 120
    assert {lane.damage for lane in lanes} == {f"leg_{leg}" for leg in ("rf", "rm", "rr", "lf", "lm", "lr")}
    assert [lane.index for lane in lanes] == list(range(120))


@pytest.mark.parametrize("text, seeds", [("3", (0, 1, 2)), ("3,7,11", (3, 7, 11)), ("5,", (5,))])
def test_seeds(text, seeds):
    assert plan.parse_seeds(text) == seeds


@pytest.mark.parametrize("name", ["default", "paper", "smoke"])
def test_presets_are_possible(name):
    assert plan.make(preset(name)).lanes


def test_swept_values_add_lanes():
    swept = config(seeds="2", damage="leg_rm", srl=SRLConfig(dropout=(0.03, 0.1), beta=(0.5, 0.6)))
    lanes = plan.make(swept).lanes
    assert [lane.algo for lane in lanes].count("ddpg") == 2
    assert {lane.label for lane in lanes if lane.algo == "srl"} == {
        f"dropout={d} beta={b}" for d in ("0.03", "0.1") for b in ("0.5", "0.6")
    }


def test_schedule_is_in_force_from_its_steps_on():
    made = plan.make(config(damage_schedule="healthy@0,tibia_rm@20000,leg_rm@40000", seeds="1", algos="srl"))
    (lane,) = made.lanes
    assert [made.damage(lane, step) for step in (0, 19_999, 20_000, 40_000)] == [
        "healthy",
        "healthy",
        "tibia_rm",
        "leg_rm",
    ]


BAD = {
    "algos is 'dqn'": {"algos": "dqn"},
    "algos is 'srl,srl'": {"algos": "srl,srl"},
    "seeds is 'ten'": {"seeds": "ten"},
    "seeds is '0'": {"seeds": "0"},
    "seeds is '3,3'": {"seeds": "3,3"},
    "leg_xx": {"damage": "leg_xx"},
    "steps is 50001": {"steps": 50_001},
    "train.capacity is 1601": {"train": TrainConfig(capacity=1601)},
    "train.prior_steps": {"train": TrainConfig(capacity=1600)},
    "srl.draws is 9": {"srl": SRLConfig(draws=9)},
    "srl.draws is 0": {"srl": SRLConfig(draws=0)},
    "srl.dropout is 1": {"srl": SRLConfig(dropout=(1.0,))},
    "srl.actor_lr": {"srl": SRLConfig(actor_lr=(-1.0,))},
    "write name@step": {"damage_schedule": "healthy"},
    "begin at 0": {"damage_schedule": "healthy@8"},
    "multiples of train.environments": {"damage_schedule": "healthy@0,leg_rm@15"},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_configurations(message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")) as caught:
        plan.make(config(**BAD[message]))
    assert "\n" not in str(caught.value)


def test_memory_is_refused_with_its_arithmetic():
    with pytest.raises(ValueError, match=r"memory_gb is 1, .*120 rows x 50000 transitions x 123 floats x 4 bytes"):
        plan.check_memory(config(memory_gb=1.0), 120)
    assert "2.75 GiB replay" in plan.check_memory(config(), 120)


def test_only_agents_that_replay_are_given_memory():
    assert plan.capacity(config(algos="tripod,ite,mcpg")) == config().train.environments
    assert plan.capacity(config(algos="tripod,ddpg")) == config().train.capacity
