"""What `experiments/peers.py` compares does the same work, or else compares nothing; and how the work is reckoned."""

import dataclasses
import os
from functools import partial
from importlib import util

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.contenders import job, measuring, physics, scaling, vmapped
from experiments.contenders.measuring import Contender, Result
from srl_jax.config import preset
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.hexapod import EnvState
from srl_jax.env.settings import EnvConfig
from tests.conftest import DEVICES

SMOKE = dataclasses.replace(preset("smoke"), algos="ddpg")


@pytest.mark.slow
def test_all_simulators_move_the_same_robots_alike(monkeypatch):
    monkeypatch.setattr("srl_jax.cli.devices.use_devices", lambda wanted, **_: DEVICES)  # jax has started
    theirs, ours = physics.in_c(4, 2, 0.01), physics.in_jax("star", 4, DEVICES, 0.01)
    where = np.array(theirs.facts["position"])
    np.testing.assert_allclose(ours.facts["position"], where, atol=1e-4)
    assert len(where) == 4 and np.ptp(where[:, 0]) > 0.01  # each has its own targets and its own damage
    for runner in (theirs, ours):
        assert runner.units > 0 and runner.units % (4 * hexapod.SUBSTEPS * physics.PERIODS) == 0


@pytest.mark.slow
def test_a_contender_that_fails_is_reported_and_stops_nobody():
    said, core = [], (tuple(measuring.cores()[:1]),)
    makes = {
        "refuses": partial(int, "no number"),
        "is killed": partial(os._exit, 9),
        "runs": partial(physics.in_c, 1, 1, 0.001),
    }
    contenders = [Contender(name, make, core) for name, make in makes.items()]
    twice = Contender("in two processes", makes["runs"], core * 2)
    *found, two = measuring.interleave([*contenders, twice], 3, said.append)
    refuses, killed, runs = found
    assert "no number" in refuses.failed and "killed" in killed.failed and not runs.failed
    assert [len(one.seconds) for one in found] == [0, 0, 3]
    assert runs.rate == runs.units / sorted(runs.seconds)[1] and runs.peak
    assert two.cores == 1 and two.units > runs.units / 10 and two.peak > 1.5 * runs.peak
    assert sum("failed" in line for line in said) == 2
    assert physics.rows({1: found})[1][0][1:4:2][0] == "failed"


def contender(processes: int) -> Contender:
    return Contender("x", lambda: pytest.fail("is not run"), tuple((core,) for core in range(processes)))


def test_a_job_is_reckoned_from_its_parts():
    facts = {"done": 100, "again_seconds": 5.0, "again_in_start": True}
    # Two processes, 200 steps each in the median of 2 s: 100 steps/s in each; 3 turns of 900 more steps, 2 begun anew.
    result = Result("x", 2, units=400.0, seconds=(2.0, 1.0, 4.0), start=20.0, facts=facts)
    assert job.total(job.Entry(contender(2), 3, 1), result, 1_000) == job.Total(result, 15.0 + 10.0 + 27.0, True)
    # One process in which ten runs advance together, 20 steps/s each.
    once = dataclasses.replace(result, facts=facts | {"again_in_start": False})
    assert job.total(job.Entry(contender(1), 1, 10), once, 1_000).seconds == pytest.approx(20.0 + 900 / 20.0)
    whole = dataclasses.replace(result, facts={"whole": True})
    assert job.total(job.Entry(contender(2), 3, 1), whole, 1_000) == job.Total(whole, 22.0, False)
    failed = dataclasses.replace(result, seconds=(), failed="of itself")
    assert [row[1] for row in job.rows([job.Total(result, 60.0, True), job.Total(failed, None, True)])[1]][
        1
    ] == "failed"


def test_every_contender_does_every_run(monkeypatch):
    monkeypatch.setattr(job, "cores", lambda: [0, 1])
    config = dataclasses.replace(preset("default"), algos="ddpg")
    found = {entry.contender.name: entry for entry in job.entries(config, 20, tuple(job.TITLES), cold=True)}
    assert len(found) == 8
    for name, entry in found.items():
        assert len(entry.contender.cores) * entry.turns * entry.width == 60, name
        assert entry.contender.environment["JAX_ENABLE_COMPILATION_CACHE"] == "false"
    assert found["SBX, a process a core"].turns == 30 and found["vmap over seeds, MJX, one process"].turns == 6


def test_lanes_are_flat_where_none_costs_a_tenth_more_or_less():
    def row(lanes: int, relative: float) -> scaling.Row:
        return scaling.Row(Result("x", 1, 1.0, (1.0,), facts={"lanes": lanes}), relative)

    few = [row(1, 3.0), row(16, 1.02)]
    assert scaling.verdict({1: [*few, row(64, 0.93)]}).startswith("1 device: flat")
    assert "not flat" in scaling.verdict({2: [*few, row(64, 1.13)]}) and "64 lanes, +13%" in scaling.verdict(
        {2: [*few, row(64, 1.13)]}
    )
    assert scaling.verdict({1: [row(4, 2.0)]}) == ""


@pytest.mark.slow
def test_the_vmapped_loop_remembers_and_learns_seed_by_seed(monkeypatch):
    def moved(robot, damage, state: EnvState, control: jax.Array) -> EnvState:
        return state._replace(qpos=state.qpos.at[7:].set(control).at[0].add(0.01))  # any physics will do

    monkeypatch.setattr(hexapod, "simulate", moved)
    train = dataclasses.replace(SMOKE.train, capacity=60, warmup=40)
    agent = dataclasses.replace(SMOKE.ddpg, freeze=(0.0,), critic_updates=2)
    loop = vmapped.Loop(dataclasses.replace(SMOKE, train=train, ddpg=agent, env=EnvConfig(episode_steps=4)))
    keys, damage = jax.vmap(jax.random.key)(jnp.arange(2)), damages.build("leg_rm")
    start = jax.vmap(loop.start, (0, None))(keys, damage)
    go = jax.jit(jax.vmap(loop.go, (0, 0, None, None, None, None)))
    warm = go(start, keys, damage, jnp.int32(0), jnp.int32(2), jnp.bool_(False))
    later = go(warm, keys, damage, jnp.int32(40), jnp.int32(2), jnp.bool_(True))

    actors = [np.asarray(carry.agent.actor["params"]["action"]["kernel"]) for carry in (start, warm, later)]
    np.testing.assert_array_equal(actors[0], actors[1])
    assert (actors[2] != actors[1]).any((1, 2)).all() and (actors[2][0] != actors[2][1]).any()
    size, rows = loop.size, np.asarray(later.memory).reshape(2, 6, 10, -1)  # seeds, rows of vector steps, robots
    order = [2, 3, 4, 5, 0, 1]  # the oldest two of eight steps were overwritten
    now, following = rows[:, order][..., :size], rows[:, order][..., size : 2 * size]
    linked = (following[:, :-1] == now[:, 1:]).all(-1)
    assert linked[:, [0, 2, 3, 4]].all()
    assert not linked[:, 1].any(), "time cuts every episode off after four steps"


BENCH = pytest.mark.skipif(
    util.find_spec("sbx") is None, reason="the extra bench (pip install -e '.[bench]') is not installed"
)


@BENCH
@pytest.mark.parametrize("library", ["sbx", "sb3"])
def test_libraries_take_as_many_steps_and_updates_as_ours(library):
    from experiments.contenders import baselines

    config = dataclasses.replace(SMOKE, train=dataclasses.replace(SMOKE.train, warmup=40, capacity=400))
    runs = [(0, "leg_rm"), (1, "leg_rf")]
    with jax.numpy_rank_promotion("allow"):
        runner = baselines.runner(library, config, runs, 100)
        model = runner.run()
        whole = baselines.runner(library, dataclasses.replace(config, steps=100), runs, 100)
        whole.run()
    assert runner.units == 100 and runner.facts["done"] == 60
    assert model.num_timesteps == 160 and model.replay_buffer.size() * 10 == 160
    # Every 20 steps from the 60th on ten mini-batches for the critics, of which one is the actor's too.
    assert model._n_updates == 6 * config.ddpg.critic_updates and model.policy_delay == config.ddpg.critic_updates
    assert whole.units == 200 and whole.facts == {"whole": True}
