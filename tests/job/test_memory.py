"""The arithmetic before a run: what it allocates, in how many waves, and that the paper's own networks do learn."""

import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.agents import registry
from srl_jax.config import preset
from srl_jax.env.hexapod import ACTION_SIZE, observation_size
from srl_jax.job import memory, plan, start
from srl_jax.job.teachers import scripted_gait
from srl_jax.program import replay
from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import TRAIN, tuned_gait


def config(**changes):
    return dataclasses.replace(preset("default"), **changes)


def test_a_replay_is_counted_for_the_lanes_that_have_one():
    every = config(algos="tripod,ddpg,ite", task="x")
    lanes = plan.make(every).lanes
    each = replay.size(50_000, 10, replay.Sizes(observation_size("x", every.env), ACTION_SIZE, 100))
    assert memory.needed(every, lanes, 2).replay == 60 * each
    still = [lane for lane in lanes if lane.algo == "tripod"]
    assert memory.needed(every, still, 2).replay == 0


def test_padding_is_counted_too():
    three = plan.make(config(seeds="3", algos="ddpg", damage="leg_rm")).lanes
    assert memory.needed(config(), three, 2).replay == memory.needed(config(), [*three, three[0]], 2).replay


@pytest.mark.parametrize("algo", ["ddpg", "srl", "bac", "ite", "tripod"])
def test_an_agents_bytes_are_those_of_its_arrays(algo):
    size = observation_size("p2p", config().env)
    agent = registry.agent(config().agent(algo))
    made = agent.init(jax.random.key(0), size, ACTION_SIZE, teachers=(tuned_gait(),))
    assert memory.agent_bytes(config(), algo) == sum(leaf.nbytes for leaf in jax.tree.leaves(made))


def test_waves_hold_every_lane_once_in_as_few_parts_as_fit():
    lanes = plan.make(config()).lanes
    whole = sum(memory.needed(config(), lanes, 2)) / 2**30
    assert [len(wave) for wave in memory.waves(config(memory_gb=whole), lanes, 2)] == [120]
    parts = memory.waves(config(memory_gb=whole - 0.01), lanes, 2)
    assert [len(wave) for wave in parts] == [60, 60]
    assert sorted(lane.index for wave in parts for lane in wave) == list(range(120))
    assert all({lane.algo for lane in wave} == {"ddpg", "srl"} for wave in parts)


def test_what_fits_in_no_wave_is_refused_with_its_arithmetic():
    with pytest.raises(ValueError, match=r"memory_gb is 0.5, .* a single lane .* GiB replay .* GiB agents"):
        memory.waves(config(memory_gb=0.5), plan.make(config()).lanes, 2)


def test_the_paper_starts_with_its_own_defaults_and_says_what_it_will_cost():
    paper = preset("paper")
    lanes = plan.make(paper).lanes
    waves = memory.waves(paper, lanes, 2)
    assert len(waves) > 1, "its networks do not all fit, so it is trained in parts"
    assert sum(memory.needed(paper, waves[0], 2)) <= paper.memory_gb * 2**30
    said = memory.describe(paper, waves, 2)
    assert f"in {len(waves)} waves" in said and "years at 100 GFLOP/s" in said


def test_operations_are_counted_per_update():
    once, twice = config(steps=50_000), config(steps=100_000)
    lanes = {"ddpg": 60, "srl": 60}
    assert memory.operations(twice, lanes) == pytest.approx(2 * memory.operations(once, lanes))
    assert memory.operations(once, {"tripod": 60}) == 0.0
    actor = 51 * 64 + 64 * 64 + 64 * 18  # products of matrices; biases and LayerNorm add a few in a hundred
    critic = 2 * (69 * 64 + 64 * 64 + 64)
    parts = config().ddpg.critic_updates
    update = 128 * (parts * (2 * (actor + critic) + 6 * critic) + 6 * (actor + critic))
    assert memory.operations(once, {"ddpg": 1}) / 2_500 == pytest.approx(update, rel=0.06)


@pytest.mark.slow
def test_the_papers_networks_take_updates():
    paper = preset("paper")
    few = dataclasses.replace(paper.train, warmup=2, prior_steps=4, capacity=16)
    one = dataclasses.replace(paper, train=few, seeds="1", damage="leg_rm", algos="srl")
    one = one.with_agents(srl=dataclasses.replace(paper.srl, freeze=(0.0,), batch=4))
    teachers = (scripted_gait(),)
    engine = Engine(start.make_program(one, lay_out(plan.make(one).lanes, 1), teachers))
    data = start.make_lanes(engine.program, one, teachers, "train", ["leg_rm"])
    state = start.init_state(engine, data)
    before = np.asarray(jax.tree.leaves(state.agents["srl"].actor)[0])
    state, tally = engine.chunk(state, tallies.empty(engine.program), data, TRAIN(), 4)
    assert float(tally.updates) == 3 and bool(state.alive[0])
    assert {x.shape[-1] for x in jax.tree.leaves(state.agents["srl"].critic)} >= {1200, 600, 1}
    assert np.abs(np.asarray(jax.tree.leaves(state.agents["srl"].actor)[0]) - before).max() > 0.0
