"""What a robot supposes of damage that nobody foresaw."""

import jax
import numpy as np
import pytest

from srl_jax.atlas import recovery, suspects
from srl_jax.atlas.robots import CRobot, World
from srl_jax.env import damage, damage_names
from srl_jax.env import gait as gaits
from srl_jax.env.damage_names import catalogue, lost
from srl_jax.env.senses import felt, observation

LEGS_LEFT = np.ones(18, bool)


def answering(name):
    return np.asarray(damage.present(damage.build(name)))


@pytest.mark.parametrize("name", [*(n for n in catalogue()[1:] if ":" not in n), *lost(3), "tibia_rf+femur_lm+leg_rr"])
def test_a_loss_of_links_is_known_by_its_silence(name):
    assert suspects.composed(answering(name)) == damage_names.canonical(name)


def test_no_silence_and_silence_that_no_loss_explains_are_nothing():
    assert suspects.composed(np.ones(18, bool)) is None
    before_one_that_answers = np.ones(18, bool)
    before_one_that_answers[3] = False  # the coxa of the right middle leg, whose tibia answers
    assert suspects.composed(before_one_that_answers) is None


def test_one_fault_more_is_supposed_of_every_servo_that_answers_and_has_none():
    angles = np.zeros(18)
    angles[4] = np.radians(22.0)  # the femur of the right middle leg
    names = suspects.supposed("leg_rf+tibia_rm:limp", answering("leg_rf"), angles)
    assert len(names) == len(set(names)) == 14 * 4 + 4 <= suspects.ROOM, "14 servos in four ways, four tibiae short"
    assert "leg_rf+femur_rm:locked=20+tibia_rm:limp" in names
    assert all(damage_names.canonical(name) == name and "leg_rf" in name and "tibia_rm:limp" in name for name in names)
    assert "coxa_rm:weak=0.5" in suspects.supposed("healthy", LEGS_LEFT, angles)
    assert len(suspects.supposed("healthy", LEGS_LEFT, angles)) <= suspects.ROOM


def judged(true):
    """Counts the leaves in which a damage is as the true one."""

    def judge(own):
        same = [
            np.isclose(mine, right[None]).reshape(len(mine), -1).sum(axis=1)
            for mine, right in zip(own, damage.build(true), strict=True)
        ]
        return 10.0 * np.sum(same, axis=0)

    return judge


def a_log(present):
    heard = np.repeat(present[None], suspects.STEPS, axis=0)
    heard[::5] = False  # every fifth packet is lost
    return suspects.Log(np.zeros((suspects.STEPS, 18)), np.zeros((suspects.STEPS, 24)), heard)


@pytest.mark.parametrize("true", ["coxa_lm:limp", "femur_rf:limp+tibia_lm:locked", "leg_rr+femur_lf:weak=0.5"])
def test_faults_are_added_while_they_explain_more(true):
    assert suspects.search(judged(true), a_log(answering(true))) == true


def test_a_healthy_robot_is_suspected_of_nothing():
    assert suspects.search(judged("healthy"), a_log(LEGS_LEFT)) is None


def test_two_faults_are_found_in_what_a_robot_felt_in_another_world(atlas):
    """C MuJoCo on another floor, with noise, under the tripod: nothing of its damage is told."""
    true = "femur_rf:locked+coxa_lm:limp"
    body = CRobot(true, 0, world=World(friction=0.9))
    recorder, phase, senses = suspects.Recorder(), 0.0, body.reset()
    act, clock = jax.jit(lambda seen: gaits.act(gaits.load(), seen)), atlas.about["clock_hz"]
    while not recorder.full:
        phase = np.float32((phase + clock / 20.0) % 1.0)
        action = np.asarray(act(observation(senses, phase, task="x", kind="onboard")))
        senses = body.step(action)
        recorder.add(action, senses)
    known, mind = recovery.knowledge(atlas), recovery.mind_of(atlas)
    log = recorder.log()
    assert suspects.search(lambda own: np.asarray(recovery._explain(known, own, log, mind=mind)), log) == true


def test_the_recorder_keeps_the_latest():
    recorder = suspects.Recorder()
    senses = CRobot("healthy", 0).reset()
    for step in range(suspects.STEPS + 3):
        assert recorder.full == (step >= suspects.STEPS)
        recorder.add(np.full(18, step), senses)
    log = recorder.log()
    assert log.action[0, 0] == 3 and log.action[-1, 0] == suspects.STEPS + 2
    assert log.felt.shape == (suspects.STEPS, 24) and log.answering.all()
    np.testing.assert_array_equal(log.felt[0], felt(senses))
