"""A run of another robot than the PhantomX: its plan, its size, what it leaves, and who refuses it."""

import csv
import dataclasses
import json
import subprocess
import sys

import jax
import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.env.anatomy import QUADRUPED
from srl_jax.env.hexapod import observation_size
from srl_jax.env.settings import EnvConfig
from srl_jax.job import atlas, command, export, files, memory, plan, students
from srl_jax.job import teachers as sources
from srl_jax.report.join import check
from srl_jax.show.walker import by_policy
from tests.job.untrained import write


def config(**fields):
    env = EnvConfig(observation="onboard", episode_steps=40)
    return dataclasses.replace(preset("smoke", "quadruped"), task="x", env=env, **fields)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of random students of the quadruped."""
    directory = tmp_path_factory.mktemp("robots") / "run"
    write(config(algos="srl", damage="healthy,shin_lr"), directory)
    return directory


def test_lanes_are_of_its_own_damages():
    assert {lane.damage for lane in plan.make(config(damage="task")).lanes} == {f"shin_{leg}" for leg in QUADRUPED.legs}
    assert preset("smoke", "quadruped").damage == "leg_rr" and preset("smoke").damage == "leg_rm"
    mixed = config(damage_mix="losses+healthy", algos="srl")
    assert len(plan.parse_mix(mixed)) == 13
    schedule = plan.make(config(damage_schedule="healthy@0,thigh_rf@800")).stages
    assert schedule == ((0, "healthy"), (800, "thigh_rf"))
    with pytest.raises(ValueError, match="unknown part 'leg_rm'"):
        plan.make(config(damage_schedule="healthy@0,leg_rm@800"))


def test_it_takes_the_room_of_twelve_joints():
    small, large = config(damage="healthy"), dataclasses.replace(config(damage="healthy"), robot="phantomx")
    assert memory.replay_bytes(small, 1_600) < memory.replay_bytes(large, 1_600)
    assert memory.agent_bytes(small, "srl") < memory.agent_bytes(large, "srl")


def test_a_run_of_a_version_that_knew_one_robot_is_read_and_joined(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
        own = dataclasses.replace(preset("smoke"), seeds={"old": "0,", "new": "1,"}[name], algos="srl")
        files.write_config(tmp_path / name, own, 1)
        (tmp_path / name / "lanes.csv").write_text(
            f"lane,algo,seed,task,damage,variant\n0,srl,{int(name == 'new')},p2p,leg_rm,\n"
        )
        (tmp_path / name / "metrics.csv").write_text("step,lane,metric,value\n")
    path = tmp_path / "old" / "config.json"
    stored = json.loads(path.read_text())
    del stored["config"]["robot"]
    path.write_text(json.dumps(stored))
    assert files.read_config(tmp_path / "old")[0].robot == "phantomx"
    check([tmp_path / "old", tmp_path / "new"])


def test_the_command_names_the_robot():
    assert "--robot quadruped" in command.again(config()) and "--damage leg_rr" in command.again(config())
    assert "--robot" not in command.again(preset("smoke"))


def test_students_and_exports_are_of_twelve_joints(finished):
    run = students.open_run(finished)
    assert run.robot.anatomy is QUADRUPED
    seen = np.zeros(observation_size("x", run.config.env, QUADRUPED), np.float32)
    assert run.policy(run.plan.lanes[0])(seen).shape == (12,)
    assert all(teacher(seen).shape == (12,) for teacher in run.advisers(run.plan.lanes[0]))
    (policy, *_) = export.from_run(finished, damages=("shin_lr:removed",))
    assert policy.about["robot"] == "quadruped" and policy.action_size == len(policy.about["action_scale"]) == 12
    with pytest.raises(ValueError, match="policy is for robot 'quadruped': this one is the phantomx"):
        by_policy(policy)


def test_it_teaches_only_its_own_kind(finished):
    own = config(damage="shin_lr", behaviour=str(finished))
    sources.check(own)
    with pytest.raises(ValueError, match="was trained with robot=quadruped, this run has robot=phantomx"):
        sources.check(dataclasses.replace(own, robot="phantomx"))
    (teacher,) = sources.load(own, finished, lambda *_: False) or ()
    assert jax.tree.leaves(teacher.params(plan.make(own).lanes))[0].shape[0] == 4


def test_its_runs_make_no_atlas(finished, tmp_path):
    with pytest.raises(ValueError, match="was trained with robot=quadruped: an atlas is the phantomx's"):
        atlas.from_run(finished, tmp_path / "atlas.npz")


@pytest.mark.slow
def test_a_whole_run_through_the_command_line(tmp_path):
    out = tmp_path / "run"
    options = "--robot quadruped --preset smoke --seeds 1 --task x --env.stride-starts 0.5 --damage-mix losses+healthy"
    asked = [sys.executable, "-m", "srl_jax.run", *options.split(), "--out", str(out)]
    subprocess.run(asked, check=True, capture_output=True, timeout=600)
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["methods"]) == {"ddpg", "srl"}
    assert len(list((out / "videos").glob("*.mp4"))) == 2 and "--robot quadruped" in (out / "report.html").read_text()
    with (out / "metrics.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["metric"] == "reference/distance"]
    assert rows and all(float(row["value"]) > 0.5 for row in rows)  # m in two seconds, by the trot
