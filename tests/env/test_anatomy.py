"""Robots as descriptions: what ships, what a description must say, and a user's own, by its MJCF."""

import dataclasses
import json
from functools import partial

import jax
import numpy as np
import pytest

from srl_jax.config import Config, preset
from srl_jax.env import anatomy, damage, gait, hexapod
from srl_jax.env.anatomy import PHANTOMX, QUADRUPED, Anatomy
from srl_jax.env.model import check, load_model, xml_text
from srl_jax.env.settings import EnvConfig
from srl_jax.job import plan

NAMES = {"hip": "yaw", "thigh": "upper", "shin": "lower"}


@pytest.fixture
def mine(tmp_path, monkeypatch) -> Anatomy:
    """A robot of other names than those that ship, in a folder of its own, and registered."""
    text = xml_text(QUADRUPED)
    for old, new in NAMES.items():
        text = text.replace(f"{old}_", f"{new}_")
    (tmp_path / "mine.xml").write_text(text)
    (tmp_path / "mine.json").write_text(gait.path(QUADRUPED).read_text())
    robot = dataclasses.replace(
        QUADRUPED,
        name="mine",
        mjcf=str(tmp_path / "mine.xml"),
        segments=tuple(NAMES.values()),
        gait=str(tmp_path / "mine.json"),
    )
    monkeypatch.setattr(anatomy, "_known", dict(anatomy._known))
    anatomy.register(robot)
    return robot


def test_robots_are_found_by_name():
    assert anatomy.named("phantomx") is PHANTOMX and anatomy.named("quadruped") is QUADRUPED
    assert Config().anatomy is PHANTOMX and Config(robot="quadruped").anatomy is QUADRUPED
    with pytest.raises(ValueError, match=r"^robot is 'spot': choose one of phantomx, quadruped\.$"):
        anatomy.named("spot")


def test_a_name_is_one_robots(mine):
    anatomy.register(mine)  # the same again
    with pytest.raises(ValueError, match="name is 'mine': give one that is none of phantomx, quadruped, mine"):
        anatomy.register(dataclasses.replace(mine, phases=(0.0,) * 4))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"legs": ("rf", "rf")}, r"legs is \('rf', 'rf'\): give names of letters and digits"),
        ({"legs": ()}, "legs is"),
        ({"segments": ("hip", "shin")}, r"segments is \('hip', 'shin'\): 3 are needed"),
        ({"segments": ("hip", "leg", "shin")}, "'leg' names a whole leg"),
        ({"segments": ("hip", "lower_leg", "shin")}, "give names of letters and digits"),
        ({"mounts": (0.0,)}, r"mounts is \(0.0,\): 4 are needed"),
        ({"phases": (0.0, 0.5, 0.5, float("nan"))}, "give finite numbers"),
        ({"action_scale": (0.6, 0.0, 0.7)}, "give angles above 0"),
        ({"name": "my robot"}, "name is"),
    ],
)
def test_a_bad_description_is_one_sentence(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        dataclasses.replace(QUADRUPED, **changes)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('body name="torso"', 'body name="trunk"', "its body 1 must be 'torso', not 'trunk'"),
        ('position name="lower_lr"', 'position name="last"', "its actuator 11 must be 'lower_lr', not 'last'"),
        ('joint="upper_rf"/>', 'joint="lower_rf"/>', "every actuator must drive the joint of its name"),
        ('name="foot_lf"', 'name="toe"', "it has no geom 'foot_lf'"),
        (
            'name="foot_lf"',
            'class="foot"/><geom name="foot_lf" class="lower_tube"/><geom',
            "its geom 'foot_lf' must be a sphere of the body 'lower_lf'",
        ),
        (
            'class="upper_tube"/>',
            'class="upper_tube" contype="1"/>',
            "its link 'upper_rf' may touch by what",
        ),
        ('timestep="0.016666666666666666"', 'timestep="0.01"', "its timestep is 0.01 s and must be 0.01666666666666"),
        ('key name="stance"', 'key name="home"', "it has no key 'stance'"),
        ('name="track"', 'name="eye"', "it has no camera 'track'"),
        ('mass="0.028"', 'mass="28"', "its link 'upper_rf' weighs 28 kg; from 0.004 to 9 are accepted"),
    ],
)
def test_what_an_mjcf_lacks_is_one_sentence(mine, old, new, sentence, tmp_path):
    text = (tmp_path / "mine.xml").read_text()
    assert old in text
    (tmp_path / "mine.xml").write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"mine.xml is not robot 'mine': {sentence}"):
        load_model(mine)


def test_what_is_no_mjcf_is_one_sentence(mine, tmp_path):
    (tmp_path / "mine.xml").write_text('<mujoco><worldbody><geom type="sphere"/></worldbody></mujoco>')
    with pytest.raises(ValueError, match=r"^\S*mine.xml is no MJCF: [^\n]*size 0 must be positive[^\n]*\.$"):
        load_model(mine)
    (tmp_path / "mine.xml").unlink()
    with pytest.raises(ValueError, match=r"^robot 'mine' has no MJCF: there is no \S*mine.xml\.$"):
        load_model(mine)


def test_one_robots_model_is_not_anothers():
    with pytest.raises(ValueError, match="its body 2 must be 'coxa_rf', not 'hip_rf'"):
        check(load_model(QUADRUPED), PHANTOMX)


def test_a_robot_without_a_gait_says_how_to_tune_one(mine, tmp_path):
    (tmp_path / "mine.json").unlink()
    with pytest.raises(ValueError, match=r"robot 'mine' has no gait in .*: make it by python -m .* --robot mine"):
        gait.load(mine)
    (tmp_path / "mine.json").write_text(json.dumps({"gait": {"stride": 1.0}}))
    with pytest.raises(ValueError, match="has no gait in"):
        gait.load(mine)


def test_ones_own_robot_is_planned_damaged_and_stepped(mine):
    lanes = plan.make(dataclasses.replace(preset("smoke", "mine"), damage="task", task="x")).lanes
    assert {lane.damage for lane in lanes} == {f"lower_{leg}" for leg in mine.legs}
    robot = hexapod.make("x", EnvConfig(observation="onboard"), 1.0, mine)
    values = damage.build("lower_rf", mine)
    assert all(map(np.array_equal, values, damage.build("shin_rf", QUADRUPED)))
    state, seen = hexapod.reset(robot, values, jax.random.key(0))
    reached, out = jax.jit(partial(hexapod.step, robot))(values, state, gait.walker(mine)(gait.load(mine), seen))
    assert np.isfinite(out.observation).all() and (reached.qpos != state.qpos).any()
