"""Angles to steps and back, and what a command must pass."""

import mujoco
import numpy as np
import pytest

from srl_jax.env.interface import RANGE, STANCE
from srl_jax.env.model import load_model, stance
from srl_jax.robot import servo
from srl_jax.robot.table import TICK

REST = np.zeros(18)


def test_stance_and_ranges_are_those_of_the_description():
    model = load_model()
    assert np.allclose(stance(model)[7:], np.tile(STANCE, 6))
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    assert np.allclose(model.jnt_range[hinges], np.radians([[-x, x] for x in RANGE] * 6))
    assert np.allclose(model.actuator_gainprm[:, 0], servo.STIFFNESS)


@pytest.mark.parametrize("sign", [1, -1])
def test_steps_are_angles_within_half_a_step(sign):
    own = servo.Calibration(zero=np.full(18, 500), sign=np.full(18, sign))
    angles = np.random.default_rng(0).uniform(-1.2, 1.2, 18)
    back = [own.angle(joint, step) for joint, step in enumerate(own.steps(angles))]
    assert np.abs(back - angles).max() <= TICK / 2 + 1e-9
    assert own.speed(0, 10) == pytest.approx(sign * 10 * 0.111 * 2 * np.pi / 60)


def test_a_command_keeps_to_range_and_rate():
    own = servo.Servos(rate=8.0)
    wanted = np.full(18, 3.0)
    assert np.allclose(own.command(wanted, REST, REST, 0.05), 0.4)
    assert np.allclose(own.command(wanted, np.tile(np.radians(RANGE), 6), REST, 0.05), np.tile(np.radians(RANGE), 6))
    assert (servo.Servos().rate - 6.18) * 0.05 * servo.STIFFNESS == pytest.approx(1.5), "nothing is lost by it"
    wanted[3] = np.nan
    with pytest.raises(ValueError, match="wanted angle of coxa_rm is no number; nothing is sent"):
        own.command(wanted, REST, REST, 0.05)


def test_gains_are_those_of_a_pid():
    own = servo.Servos(servo.Gains(p=0.5, i=2.0, d=0.1, windup=0.015), rate=1e6)
    wanted = np.full(18, 0.1)
    assert np.allclose(own.command(wanted, REST, np.full(18, 0.2), 0.05), 0.1 + 0.05 + 0.01 - 0.02)
    assert np.allclose(own.command(wanted, REST, REST, 0.05), 0.1 + 0.05 + 0.015), "the integral is held"
    assert np.allclose(servo.Servos().command(wanted, REST, REST, 0.05), wanted)


def test_a_calibration_file(tmp_path):
    path = tmp_path / "own.json"
    path.write_text('{"tibia_rf": {"zero": 498, "sign": -1, "id": 40}}')
    own = servo.load(str(path))
    assert (own.ids[2], own.zero[2], own.sign[2]) == (40, 498, -1) and own.zero[3] == 512
    assert servo.load("").ids == servo.Calibration().ids


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "it is no JSON object of joints"),
        ("[]", "it is no JSON object of joints"),
        ('{"knee": {"zero": 1}}', "says knee: zero 1; accepted are joints such as tibia_rf"),
        ('{"tibia_rf": {"zero": 1024}}', "tibia_rf: zero 1024"),
        ('{"tibia_rf": {"sign": 0}}', "tibia_rf: sign 0"),
        ('{"tibia_rf": {"id": 1}}', "gives one id to two joints"),
    ],
)
def test_a_bad_calibration_is_one_sentence(text, message, tmp_path):
    (tmp_path / "own.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        servo.load(str(tmp_path / "own.json"))
