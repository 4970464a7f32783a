"""When it must stop, and that torque is off then."""

import numpy as np
import pytest

from srl_jax import pretrained
from srl_jax.robot import outing, safety
from srl_jax.robot.guard import LIMP
from srl_jax.robot.loop import Loop
from srl_jax.robot.policy import Walker
from srl_jax.robot.simulate.ax12 import Servo
from srl_jax.robot.simulate.line import Line
from tests.robot.made import made


def heat(body):
    body.servos[4].heat = 69.0


def drain(body):
    for servo in body.servos.values():
        servo.warm = lambda *_, own=servo: own.table.__setitem__(42, 90)


def topple(body):
    body.data.qpos[3:7] = [0.0, 1.0, 0.0, 0.0]
    body.data.qpos[2] = 0.3


def silence(body):
    body._tell = lambda: None


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (heat, "femur_rf has 69 degrees, 68 are accepted"),
        (drain, r"voltage is 9\.0 V, at least 9\.6 is accepted"),
        (topple, "it has tipped over"),
        (silence, r"the inertial unit has said nothing for 0\.2"),
    ],
)
def test_what_hurts_takes_the_torque_off(harm, message):
    own = made()
    began = []

    def react(now, sensed):
        if now > 0.3 and not began:
            began.append(own.clock.now())
            harm(own.body)

    policy = pretrained.load("atlas", task="x", damage="healthy")
    watch = safety.Watch()
    loop = Loop(own.robot, Walker(policy), own.clock, watch, lambda: False, react=react)
    import re

    assert re.search(message, outing.go(own.poses(watch), loop, 3.0))
    assert own.body.report()["torque"] == 0 and own.clock.now() - began[0] < 0.35


def test_it_stands_on_what_it_has():
    own = made("leg_lf")
    sensed = own.poses().rise()
    assert own.robot.dead == ("coxa_lf", "femur_lf", "tibia_lf")
    assert sensed.senses.gravity[2] < -0.95 and own.body.data.qpos[2] > 0.08


def test_nobody_there_and_wheels_are_refused():
    own = made()
    own.body.servos[4].write(8, bytes([0, 0]))
    with pytest.raises(ValueError, match=r"servo 4 \(femur_rf\) is set to turn endlessly"):
        own.poses().rise()
    for servo in own.body.servos.values():
        servo.alive = False
    with pytest.raises(ValueError, match="none of the servos 1 to 18 answers; look to power"):
        own.poses().rise()


def test_a_stop_while_it_rises():
    own = made()
    with pytest.raises(safety.StoppedError, match="it was asked to"):
        own.poses(stop=lambda: own.clock.now() > 1.0).rise()


def test_the_guards_packet_lets_every_servo_go():
    servos = {number: Servo(number) for number in (1, 7)}
    for servo in servos.values():
        servo.execute(3, [24, 1])
    line = Line(servos)
    assert line.feed(LIMP, 0.0) == [] and line.heard == 1
    assert not any(servo.drive.on for servo in servos.values())


def test_no_command_of_a_rise_is_far_from_its_joint():
    own, far = made(), []
    send = own.robot.send

    def watched(goals):
        far.append(np.abs(own.robot.calibration.steps(own.body.data.qpos[7:]) - goals).max())
        send(goals)

    own.robot.send = watched
    own.poses().rise()
    assert max(far) < 100, "steps, half a radian"
