"""The loop in lock-step: it walks, bears bad packets, notices lost joints, and its log computes the walk again."""

import json

import numpy as np
import pytest

from srl_jax import pretrained
from srl_jax.robot import log, outing, safety, servo
from srl_jax.robot.loop import Loop
from srl_jax.robot.policy import Walker
from srl_jax.robot.ports import BusLostError
from tests.robot.made import made, standing


@pytest.fixture(scope="module")
def policy():
    return pretrained.load("atlas", task="x", damage="healthy")


def loop(own, policy, **more):
    return Loop(own.robot, Walker(policy), own.clock, safety.Watch(), more.pop("stop", lambda: False), **more)


def test_it_rises_walks_and_lies_down(policy):
    own, places = made(), []
    place = lambda: places.append(own.body.data.qpos[:3].copy())  # noqa: E731
    walk = loop(own, policy)
    assert outing.go(own.poses(), walk, 1.5, stood=place) == ""
    place()
    assert places[0][2] > 0.09 and places[1][2] < 0.06, "it stood, and lies"
    assert places[1][0] - places[0][0] > 0.5 and own.body.report()["torque"] == 0
    assert len(walk.outcome.late) == 30 and walk.outcome.overruns == 0 and walk.outcome.jitter(1.0) < 1e-9


def test_the_log_computes_the_walk_again(policy, tmp_path):
    own = standing(given="drop=.02,corrupt=.01,late=.05")
    writer = log.Writer(tmp_path / "deep" / "walk.jsonl", {"policy": "atlas"})
    outcome = loop(own, policy, note=writer.add).run(1.0)
    assert own.body.data.qpos[0] > 0.3 and not outcome.died and outcome.missed > 0
    writer.close()
    with (tmp_path / "deep" / "walk.jsonl").open("a") as file:
        file.write('[1.0, "broken off')
    about, steps = log.read(tmp_path / "deep" / "walk.jsonl")
    assert about == {"policy": "atlas"} and [step.time for step in steps] == pytest.approx(0.05 * np.arange(1, 21))
    again = list(log.replay(steps, policy, servo.Calibration()))
    assert max(action for action, _ in again) < 1e-6 and max(goal for _, goal in again) == 0
    other = pretrained.load("atlas", task="x", damage="leg_rm")
    assert max(action for action, _ in log.replay(steps, other, servo.Calibration())) > 0.1


@pytest.mark.parametrize("text", ["", "{}\n{}\n", "{\n", json.dumps({}) + "\n[1, 2]\n"])
def test_what_is_no_log_is_one_sentence(text, tmp_path):
    (tmp_path / "walk.jsonl").write_text(text)
    with pytest.raises(ValueError, match=r"walk\.jsonl: it is no log of a walk"):
        log.read(tmp_path / "walk.jsonl")


@pytest.mark.parametrize("damage", ["tibia_lf", "leg_rm"])
def test_joints_that_die_are_known_within_four_steps_and_read_zero(damage, policy):
    own, seen = standing(), []
    own.body.prepare(damage)
    other = pretrained.load("atlas", task="x", damage=damage)

    def react(now, sensed):
        seen.append(sensed)
        if len(seen) == 10:
            own.body.strike(damage)
        if sensed.died:
            walk.walker.swap(other)

    walk = loop(own, policy, react=react)
    outcome = walk.run(1.0)
    assert outing.damage_of(own.robot.dead) == damage and walk.walker.policy is other
    assert max(when for when, _ in outcome.died) - 0.5 <= 0.2 and outcome.overruns == 0
    gone = ~own.robot.alive
    assert (seen[-1].senses.joints[gone] == 0.0).all() and not seen[-1].senses.answering[gone].any()
    assert list(np.abs(seen[-1].senses.joints) > 0.0) == list(own.robot.alive)


def test_a_dead_joint_is_a_damage():
    assert outing.damage_of(()) == "healthy"
    assert outing.damage_of(("femur_lm", "tibia_lm", "tibia_rf")) == "tibia_rf+femur_lm"
    assert outing.damage_of(("coxa_lr", "femur_lr", "tibia_lr")) == "leg_lr"


def test_a_cut_cable_ends_the_loop_and_joints_hold(policy):
    own, goals = standing(), []

    def react(now, sensed):
        own.wire.unplugged = now > 0.5
        goals.append(own.robot.sent.copy())

    walk = loop(own, policy, react=react)
    assert "the bus is lost" in outing.go(own.poses(), walk, 2.0)
    held = [each.get("goal_position") for each in own.body.servos.values()]
    assert own.body.report()["torque"] == 18 and held == list(own.robot.sent)


def test_a_silent_bus_is_not_an_amputation(policy):
    own = standing()

    def react(now, sensed):
        if now > 0.3:
            for each in own.body.servos.values():
                each.alive = False

    walk = loop(own, policy, react=react)
    began = own.clock.now()
    with pytest.raises(BusLostError, match="no servo answers"):
        walk.run(2.0)
    assert own.robot.dead == () and own.clock.now() - began < 0.3 + 0.05 + 0.15


def test_somebodys_stop_ends_the_walk_in_a_period(policy):
    own = standing()
    asked = own.clock.now() + 0.52
    outcome = loop(own, policy, stop=lambda: own.clock.now() > asked).run(2.0)
    assert outcome.stopped and own.clock.now() < asked + 0.05
    own.poses().lie_down()
    assert own.body.report()["torque"] == 0 and own.body.report()["upright"] > 0.98


def test_a_late_loop_passes_deadlines_over_and_keeps_the_clock(policy):
    own = standing()

    def react(now, sensed):
        if now == pytest.approx(0.5):
            own.clock.sleep_until(own.clock.now() + 0.13)

    walk = loop(own, policy, react=react)
    outcome = walk.run(1.0)
    assert (outcome.overruns, outcome.skipped, len(outcome.late)) == (1, 2, 18)
    assert walk.walker.phase == pytest.approx(20 * policy.about["clock_hz"] / 20 % 1)
