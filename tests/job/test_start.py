"""Students that start from pi_B: by its parameters where they fit, by cloning where not, whatever stands beside."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import behaviour as behaviours
from srl_jax.agents import registry
from srl_jax.config import preset
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.job import plan, start
from srl_jax.job.teachers import Behaviour, scripted_gait
from srl_jax.program.engine import Engine, with_damage
from srl_jax.program.lanes import lay_out

ALGOS = ("tripod", "srl", "ddpg_warm")
SIZE = 51  # of a full observation on p2p


def learned(settings) -> Behaviour:
    """pi_B as if learned: a random network of the architecture of some settings, one for every seed."""
    actor = lambda seed: registry.agent(settings).init(jax.random.key(seed), SIZE, ACTION_SIZE).actor  # noqa: E731

    def params(lanes):
        return jax.tree.map(lambda *x: jnp.stack(x), *(actor(lane.seed) for lane in lanes))

    def apply(params, observation):
        return behaviours.policy(params, observation, config=settings)

    return Behaviour(apply, params, scripted_gait().clock_hz, settings.architecture)


def begin(algos):
    """Started agents of every algorithm, and pi_B's parameters for the rows; SRL's network is wider than pi_B's."""
    base = preset("smoke")
    narrow = dataclasses.replace(base.ddpg_warm, hidden=(24, 24))
    config = dataclasses.replace(
        base, algos=",".join(algos), seeds="2", train=dataclasses.replace(base.train, clone_updates=3)
    )
    config = config.with_agents(ddpg_warm=narrow)
    pi_b = learned(narrow)
    engine = Engine(start.make_program(config, lay_out(plan.make(config).lanes, 1), (pi_b,)))
    program = engine.program
    data = start.make_lanes(program, config, (pi_b,), "train", ["leg_rm"] * len(program.layout.rows))
    agents = start.init_agents(program, data)
    seen = jax.random.normal(jax.random.key(0), (2, 40, program.observation_size))
    started = {
        algo: start.start_actor(program, algo, agents[algo], seen, data, pi_b)
        for algo in algos
        if program.agents[algo].adopt
    }
    own = {algo: jax.tree.map(lambda x, a=algo: x[program.layout.rows_of[a]], data.teachers[0]) for algo in algos}
    return started, own


@pytest.mark.parametrize("algos", list(itertools.permutations(ALGOS)))
def test_each_algorithm_starts_by_its_own_network_whatever_the_order(algos):
    started, pi_b = begin(algos)
    assert started.keys() == {"srl", "ddpg_warm"}
    for got, wanted in zip(
        jax.tree.leaves(started["ddpg_warm"].actor), jax.tree.leaves(pi_b["ddpg_warm"]), strict=True
    ):
        np.testing.assert_array_equal(got, wanted)
    widths = {leaf.shape[-1] for leaf in jax.tree.leaves(started["srl"].actor)}
    assert 32 in widths and 24 not in widths, "unequal widths are cloned, not copied"
    for agent in started.values():
        jax.tree.map(np.testing.assert_array_equal, agent.actor, agent.target_actor)


def test_clones_and_healthy_replay_in_the_program(engine, data, fresh):
    state = fresh()
    random = jax.device_get(state.agents)
    healthy = with_damage(engine.program, data, ["healthy"] * len(engine.program.layout.rows))
    state, filled = start.from_behaviour(engine, state, data, healthy, scripted_gait())
    assert int(state.clock) == 0
    assert np.all(np.abs(np.asarray(filled.prior["srl"].observation)).sum(-1) > 0.0)
    jax.tree.map(np.testing.assert_array_equal, jax.device_get(state.agents["ddpg"]), random["ddpg"])
    leaves = zip(jax.tree.leaves(state.agents["srl"].actor), jax.tree.leaves(random["srl"].actor), strict=True)
    assert any(not np.array_equal(a, b) for a, b in leaves)
