"""What a finished run has learned comes back as its policies, whatever learned it and in which wave."""

import dataclasses
import shutil
from functools import partial

import jax
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from srl_jax.agents import ddpg
from srl_jax.config import preset
from srl_jax.env import gait as gaits
from srl_jax.env.hexapod import observation_size
from srl_jax.ite import agent as ite
from srl_jax.job import files, plan, students
from srl_jax.job.teachers import from_run
from tests.conftest import DEVICES
from tests.job.untrained import write

ALGOS = ("tripod", "ddpg", "srl", "bac", "bpg", "ite", "pi_b")


@pytest.fixture(scope="module")
def config():
    base = preset("smoke")
    env = dataclasses.replace(base.env, episode_steps=100)
    return dataclasses.replace(base, task="x", seeds="2", algos=",".join(ALGOS), env=env, behaviour="gait,gait")


@jax.jit
def acts(policy, observations):
    return jax.vmap(policy)(observations)


@pytest.fixture(scope="module")
def trained(config, tmp_path_factory):
    """A run in one part, and the actor of each lane."""
    directory = tmp_path_factory.mktemp("students") / "run"
    return directory, write(config, directory)


@pytest.fixture(scope="module")
def observations(config):
    return jax.random.normal(jax.random.key(0), (5, observation_size(config.task, config.env)))


def expected(algo, config, actor, observation):
    tripod = gaits.load()
    if algo in ("tripod", "pi_b"):
        return gaits.act(tripod, observation)
    if algo == "bpg":
        values, unravel = ravel_pytree(tripod._replace(frequency=None))
        return gaits.act(unravel(values + actor["offset"]), observation)
    if algo == "ite":
        return ite.policy(actor, observation)
    return ddpg.student(actor, observation, config=config.agent(algo))


def test_every_lane_acts_by_what_it_has_learned(config, trained, observations):
    directory, actors = trained
    run = students.open_run(directory)
    assert run.algos == ALGOS and run.config == config
    seen = {}
    for algo in ALGOS:
        wanted = jax.jit(jax.vmap(partial(expected, algo, config), (None, 0)))
        for lane in run.lanes_of(algo):
            own = acts(run.policy(lane), observations)
            np.testing.assert_allclose(own, wanted(actors[lane.index], observations), atol=1e-6)
            seen[lane.algo, lane.seed] = np.asarray(own)
    for algo in ("ddpg", "srl", "bac", "bpg"):  # so that another lane's policy would not have done
        assert np.abs(seen[algo, 0] - seen[algo, 1]).max() > 1e-3


def test_what_is_compiled_for_one_lane_serves_the_others(trained, observations):
    run = students.open_run(trained[0])
    for algo in ("srl", "bpg", "tripod"):
        act = jax.jit(lambda policy, observation: policy(observation))
        for lane in run.lanes_of(algo):
            act(run.policy(lane), observations[0])
        assert act._cache_size() == 1


def test_critics_come_with_the_actors(trained):
    run = students.open_run(trained[0])
    first, second = (run.learned(lane) for lane in run.lanes_of("srl")[:2])
    assert {leaf.shape[0] for leaf in jax.tree.leaves(first["critic"])} == {run.config.srl.critics}
    assert jax.tree.structure(first) == jax.tree.structure(second)
    assert run.learned(run.lanes_of("bac")[0])["critic"] == ()


def test_lanes_are_found_in_their_waves(config, observations, tmp_path):
    config = dataclasses.replace(config, algos="bpg,tripod")
    lanes, directory, learned = plan.make(config).lanes, tmp_path / "waved", {}
    directory.mkdir()
    files.write_config(directory, config, DEVICES)
    for seed in (0, 1):
        own = [lane for lane in lanes if lane.seed == seed]
        learned |= write(config, directory / f"wave-{seed + 1}", own)
    run = students.open_run(directory)
    for lane in run.lanes_of("bpg"):
        wanted = jax.vmap(partial(expected, "bpg", config, learned[lane.index]))(observations)
        np.testing.assert_allclose(acts(run.policy(lane), observations), wanted, atol=1e-6)
    shutil.rmtree(directory / "wave-2")
    with pytest.raises(ValueError, match=r"waved has not trained lane \d+ yet: go on with it by --resume"):
        students.open_run(directory)


def test_teachers_are_the_lanes_own(trained, observations):
    run = students.open_run(trained[0])
    pi_b, fellow = run.advisers(run.lanes_of("srl")[0])
    wanted = gaits.act(gaits.load(), observations[0])
    for teacher in (pi_b, fellow):
        np.testing.assert_allclose(teacher(observations[0]), wanted, atol=1e-6)


@pytest.mark.parametrize("waves", [1, 2])
def test_pi_b_of_a_finished_run_is_the_lanes_own(waves, config, observations, tmp_path):
    hidden = dataclasses.replace(config.srl, hidden=(8,))
    healthy = dataclasses.replace(config, algos="srl", damage="healthy", behaviour="gait", srl=hidden)
    directory, lanes, learned = tmp_path / "healthy", plan.make(healthy).lanes, {}
    for number in range(waves):
        folder = directory if waves == 1 else directory / f"wave-{number + 1}"
        learned |= write(healthy, folder, lanes[number::waves])
    files.write_config(directory, healthy, DEVICES)
    taught = dataclasses.replace(config, algos="ddpg,pi_b", behaviour=str(directory))
    write(taught, tmp_path / "taught", teachers=(from_run(directory),))
    run, wanted = students.open_run(tmp_path / "taught"), partial(ddpg.student, config=hidden)
    for lane in run.lanes_of("pi_b"):
        actor = learned[lane.seed]  # one lane a seed
        for policy in (run.policy(lane), *run.advisers(run.lanes_of("ddpg")[lane.seed])):
            np.testing.assert_allclose(acts(policy, observations), wanted(actor, observations), atol=1e-6)
    assert np.abs(wanted(learned[0], observations) - wanted(learned[1], observations)).max() > 1e-3


def test_the_last_damage_of_a_schedule(config, tmp_path):
    scheduled = dataclasses.replace(config, damage_schedule="healthy@0,leg_rm@800", algos="tripod")
    run = students.Run(tmp_path, scheduled, plan.make(scheduled), (), None, {})
    assert run.damage(run.plan.lanes[0]) == "leg_rm"


def test_what_cannot_be_opened_is_a_sentence(config, trained, tmp_path):
    with pytest.raises(ValueError, match=r"has no config\.json"):
        students.open_run(tmp_path)
    files.write_config(tmp_path, config, DEVICES)
    with pytest.raises(ValueError, match="not a directory of checkpoints: a finished run has one"):
        students.open_run(tmp_path)
    copy = shutil.copytree(trained[0], tmp_path / "copy")
    taught = dataclasses.replace(config, behaviour="train", algos="tripod,ddpg,srl")
    files.write_config(copy, taught, DEVICES)
    with pytest.raises(ValueError, match=r"behaviour is not finished, and .*copy learned from it: go on with it"):
        students.open_run(copy)
    with pytest.raises(ValueError, match=r"algo is 'mcpg': .* has tripod, ddpg"):
        students.open_run(trained[0]).lanes_of("mcpg")
