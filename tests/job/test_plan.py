"""Bad configurations get one sentence that names field, value and what is accepted; good ones the right lanes."""

import dataclasses
import subprocess
import sys

import pytest

from srl_jax.agents.settings import DDPGConfig, ITEConfig, SearchConfig, SRLConfig
from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.job import plan
from srl_jax.program.settings import EvaluationConfig, TrainConfig


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


def test_a_mix_is_one_lane_a_seed_and_takes_sets_as_damage_does():
    mixed = config(seeds="2", algos="srl", damage_mix="losses21+joints+healthy")
    assert [lane.damage for lane in plan.make(mixed).lanes] == ["mix", "mix"] and plan.counts(mixed) == {"srl": 2}
    mix = plan.parse_mix(mixed)
    assert mix == plan.parse_damages(config(damage="losses21+joints+healthy")) and len(set(mix)) == len(mix) == 70
    assert plan.parse_mix(config()) == ()


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
    "has the unknown part 'losses22'": {"damage_mix": "losses22+healthy"},
    "damage_mix is 'limp': it does not go with damage_schedule": {
        "damage_mix": "limp",
        "damage_schedule": "healthy@0,leg_rm@800",
    },
    "damage_mix is 'limp': ite finds out about one damage": {"damage_mix": "limp", "algos": "ite", "task": "x"},
    "env.history is -1: it must not be negative": {"env": EnvConfig(history=-1)},
    "evaluation.episodes is 0": {"evaluation": EvaluationConfig(episodes=0)},
    "task is 'p2p': ite does x and xy only": {"algos": "ite"},
    "env.episode_steps is 40: ite": {"algos": "ite", "task": "x", "env": EnvConfig(episode_steps=40)},
    "behaviour is 'train': mcpg needs gait, first": {"algos": "mcpg", "behaviour": "train"},
    "ite.rho is 0.2,0: it must be positive": {"algos": "ite", "task": "x", "ite": ITEConfig(rho=(0.2, 0.0))},
    "mcpg.trajectories is 1: it must be at least 2": {"algos": "mcpg", "mcpg": SearchConfig(trajectories=1)},
    "ddpg.gamma is nan": {"ddpg": DDPGConfig(gamma=(float("nan"),))},
    "ddpg.hidden is": {"ddpg": DDPGConfig(hidden=())},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_configurations(message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")) as caught:
        plan.make(config(**BAD[message]))
    assert "\n" not in str(caught.value)


def test_lanes_are_counted_without_jax():
    code = """
import sys
from srl_jax.config import preset
from srl_jax.job import plan
print(len(plan.make(preset("default")).lanes), "jax" in sys.modules)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.split() == ["120", "False"]
