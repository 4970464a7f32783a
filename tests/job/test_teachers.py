"""Teachers by name: what is refused before anything is written, and a lane's own parameters."""

import dataclasses

import jax
import pytest

from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.job import files, plan
from srl_jax.job import teachers as sources
from srl_jax.program.lanes import Lane


def config(**fields):
    return dataclasses.replace(preset("smoke"), **fields)


def test_the_first_teacher_named_is_pi_b():
    assert plan.parse_teachers(config(behaviour="gait, train")) == ["gait", "train"]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"behaviour": "gait,gait"}, "name each teacher once"),
        ({"behaviour": "nothing-here"}, "give gait, train, repertoire, atlas, atlas-others, or the directory"),
        ({"behaviour": "repertoire", "damage_schedule": "healthy@0,leg_rm@800"}, "does not go with damage_schedule"),
        ({"behaviour": "repertoire", "damage_mix": "losses21"}, "does not go with damage_mix"),
    ],
)
def test_unusable_teachers_are_refused(fields, said):
    with pytest.raises(ValueError, match=said):
        sources.check(config(**fields))


def test_a_run_that_saw_another_history_teaches_nobody(tmp_path):
    files.write_config(tmp_path, config(env=EnvConfig(history=4)), 1)
    with pytest.raises(ValueError, match=r"was trained with env\.history=4, this run has env\.history=0"):
        sources.check(config(behaviour=str(tmp_path)))


def test_the_healthy_teacher_of_a_mix_has_no_mix():
    healthy = sources.MADE["train"](config(behaviour="train", damage_mix="losses21"))
    assert {lane.damage for lane in plan.make(healthy).lanes} == {"healthy"}


def test_a_missing_repertoire_is_refused(tmp_path):
    base = config(algos="ite", task="x", env=EnvConfig())
    with pytest.raises(ValueError, match="does not exist"):
        sources.check(dataclasses.replace(base, ite=dataclasses.replace(base.ite, repertoire=str(tmp_path / "map"))))


def test_the_gait_has_no_parameter_that_a_search_could_not_feel():
    gait = sources.scripted_gait()
    params = gait.params([Lane(0, "bpg", 0, "p2p", "leg_rm")] * 3)
    assert params.frequency is None and gait.clock_hz > 1.0
    assert {leaf.shape for leaf in jax.tree.leaves(params)} == {(3,)}
