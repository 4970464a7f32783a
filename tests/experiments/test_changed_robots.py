"""Students of runs that never learned walk on robots that are not the one of the simulation."""

import dataclasses

import numpy as np
import pytest

from experiments import changed_robots
from srl_jax.config import preset
from srl_jax.job import export
from tests.job.untrained import write


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Of two methods whose policies see two steps behind them."""
    directory = tmp_path_factory.mktemp("changed") / "run"
    base = preset("smoke")
    env = dataclasses.replace(base.env, observation="onboard", history=2, randomise="mild")
    config = dataclasses.replace(base, seeds="2", task="x", damage="leg_rm,tibia_lf", algos="ddpg,srl", env=env)
    write(config, directory)
    return directory


def test_every_method_has_a_row_with_a_cell_for_every_world(run, capsys):
    changed_robots.main(changed_robots.Arguments((run,), seconds=0.2, walks=1))
    said = capsys.readouterr().out.splitlines()
    assert all(world in said[0] for world in changed_robots.WORLDS)
    for line, method in zip(said[1:], ("ddpg", "srl"), strict=True):
        assert line.split(method)[0].strip() == "mild, 2 steps behind" and line.count("[") == 3


def test_a_walk_tells_the_world_it_was_in(run):
    policy = export.from_run(run, seed=0, algos=("srl",))[0]
    modelled = changed_robots.in_mujoco(policy, 0.5, 0, changed_robots.MODELLED)
    assert modelled == changed_robots.in_mujoco(policy, 0.5, 0, changed_robots.MODELLED)
    assert modelled != changed_robots.in_mujoco(policy, 0.5, 0, changed_robots.drawn(0))
    assert np.isfinite(modelled.speed) and changed_robots.drawn(0) != changed_robots.drawn(1)
