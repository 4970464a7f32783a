"""The verb deploy over a pseudo-terminal, from the policy to the simulated servos and back; and what is refused."""

import re
import signal
import subprocess
import sys
import time

import pytest

from srl_jax import portable, pretrained
from srl_jax.cli import deploy, simulate
from srl_jax.robot import log
from srl_jax.robot.simulate.child import Simulated


@pytest.fixture
def said(capsys, monkeypatch, tmp_path):
    """(words) -> exit code and what was printed, in an empty folder; signals stay as they are."""
    monkeypatch.chdir(tmp_path)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def ask(*words, verb=deploy):
        with pytest.raises(SystemExit) as ended:
            verb.main([str(word) for word in words])
        return ended.value.code, capsys.readouterr()

    yield ask
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_a_simulated_robot_walks_over_a_pseudo_terminal(said, tmp_path):
    words = ("--simulate", "--seconds", 1.0, "--trained-for", "leg_rm", "--damage", "leg_rm", "--strike", 0)
    for _ in range(5):  # in real time: where a busy machine does not let the simulation answer, the bus is lost
        code, printed = said(*words)
        if code == 0:
            break
    out = printed.out
    assert "It stands on " in out and re.search(r"It walked \d\.\d s, \d\.\d\d m, \d+ steps", out), (code, printed)
    assert "Goals went out late by" in out and "Packets: " in out and "Silent joints: coxa_rm" in out
    about, steps = log.read(tmp_path / "walk.jsonl")
    assert about["trained_for"] == "leg_rm" and len(steps) > 3


def test_a_dry_run_says_what_would_be_sent_and_sends_nothing(said):
    with Simulated() as robot:
        code, printed = said("--port", robot.bus, "--imu", robot.imu, "--seconds", 0.2, "--dry-run")
        assert robot.report()["torque"] == 0
    assert code in (0, 1)
    assert "servo 4: torque_limit = 1023" in printed.out and "all servos: torque_enable = 0" in printed.out
    assert re.search(r"goal_position: 2=\d+ 4=\d+", printed.out)


def test_a_program_that_was_killed_leaves_a_robot_without_torque(tmp_path):
    with Simulated() as robot:
        words = ["--port", robot.bus, "--imu", robot.imu, "--log", str(tmp_path / "walk.jsonl")]
        command = [sys.executable, "-m", "srl_jax.deploy", *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        until = time.monotonic() + 60.0
        while robot.report()["torque"] == 0 and time.monotonic() < until:
            time.sleep(0.05)
        process.kill()
        process.communicate()
        until = time.monotonic() + 10.0
        while robot.report()["torque"] and time.monotonic() < until:
            time.sleep(0.02)
        assert robot.report()["torque"] == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "port is '': give the adapter's, such as /dev/ttyUSB0, or --simulate"),
        (["--port", "/dev/x", "--simulate"], "port is '/dev/x': give"),
        (["--port", "/dev/x"], "imu is missing: give its port"),
        (["--simulate", "--imu", "/dev/y"], "imu is '/dev/y': a simulated robot has its own"),
        (["--port", "/dev/nowhere", "--imu", "none"], "port is /dev/nowhere: it cannot be opened as a serial port"),
        (["--port", "FILE", "--imu", "none"], "it cannot be opened as a serial port"),
        (["--simulate", "--seconds", "nan"], "seconds is nan: accepted is 0.05 to 86400"),
        (["--simulate", "--torque", "2"], "torque is 2.0: accepted is 0.05 to 1"),
        (["--simulate", "--damage", "knee"], "unknown part 'knee'"),
        (["--simulate", "--faults", "drop=2"], "faults has 'drop=2': accepted are drop, corrupt, late"),
        (["--simulate", "--log", "."], "log is .: give a file"),
        (["--simulate", "--resume", "learned"], "resume is 'learned' without --learn: give both"),
        (["--port", "/dev/x", "--imu", "none", "--learn"], "odometer is missing: a reward needs how far"),
        (["--simulate", "--learn", "--odometer", "/dev/y"], "odometer is '/dev/y': a simulated robot has its own"),
        (["--simulate", "--learn", "--algo", "ite"], "algo is 'ite': what a robot learns by is srl or ddpg_warm"),
        (["--simulate", "--learn", "--dry-run"], "dry-run is True: a robot that does not move"),
        (["--simulate", "--learn", "--episode", "nan"], "episode is nan: accepted is 0.5 to 600"),
        (["--simulate", "--learn", "--updates", "0"], "updates is 0: accepted is 1 to 100"),
        (["leg", "--simulate", "--learn", "--behaviour", "atlas"], "policy is 'leg' and behaviour 'atlas': leave one"),
        (["--simulate", "--learn", "--resume", "."], "resume is .: there is no state.npz in it"),
        (["tripod", "--simulate"], "policy is 'tripod', a script that needs jax"),
        (["sarl", "--simulate"], "policy is 'sarl': give"),
        (["srl", "--simulate"], "policy reads the observation 'full', of which a robot's sensors give"),
        (["P2P", "--simulate"], "policy is for task 'p2p', for which a robot must know where it is"),
        (["--simulate", "--trained-for", "leg_rm+leg_lf+leg_lr"], "damage is 'leg_rm+leg_lf+leg_lr': atlas for x"),
    ],
)
def test_bad_input_is_one_sentence(words, message, said, tmp_path):
    (tmp_path / "file").write_text("")
    policy = pretrained.load("atlas", task="x", damage="healthy")
    policy.about["task"], kept = "p2p", policy.about["task"]
    portable.save(tmp_path / "p2p.npz", [policy])
    policy.about["task"] = kept
    names = {"FILE": tmp_path / "file", "P2P": tmp_path / "p2p.npz"}
    code, printed = said(*(names.get(word, word) for word in words))
    assert code == 2 and message in printed.err
    assert printed.err.count("\n") == 1 and printed.out == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--damage", "knee"], "unknown part 'knee'"),
        (["--strike", "-1"], "strike is -1.0: at least 0 is accepted"),
        (["--latency", "nan"], "latency is nan"),
        (["--faults", "drop"], "faults has 'drop'"),
        (["--faults", "lost=.1"], "faults has 'lost=.1'"),
    ],
)
def test_what_no_robot_can_be_is_one_sentence(words, message, said):
    code, printed = said(*words, verb=simulate)
    assert code == 2 and message in printed.err and printed.err.count("\n") == 1
