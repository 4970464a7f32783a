"""The verb deploy --learn: killed as a whole it goes on, and somebody puts a robot right that has fallen."""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from srl_jax import pretrained
from srl_jax.cli.deploy_learn import Key, Learning
from srl_jax.cli.deploy_options import Arguments
from srl_jax.job.course import STATE, Course
from srl_jax.robot.safety import StoppedError

WALK = ("--simulate", "--learn", "--damage", "leg_rm", "--strike", "1")


def children(pid: int) -> list[int]:
    """Processes that a process has started, and theirs."""
    try:
        own = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []
    return own + [each for child in own for each in children(child)]


def alive(pid: int) -> bool:
    """Whether a process still runs."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def waited(done, seconds: float) -> bool:
    until = time.monotonic() + seconds
    while not done() and time.monotonic() < until:
        time.sleep(0.05)
    return bool(done())


@pytest.mark.slow  # in real time, and each process compiles
def test_it_is_killed_as_a_whole_and_goes_on(tmp_path):
    command = [sys.executable, "-m", "srl_jax.deploy", *WALK]
    first = subprocess.Popen(
        [*command, "--seconds", "300", "--out", "learned"], cwd=tmp_path, start_new_session=True, stdout=subprocess.PIPE
    )
    assert waited((tmp_path / "learned" / STATE).exists, 240.0), "nothing was saved"
    others = children(first.pid)
    first.kill()
    first.communicate()
    assert len(others) >= 2 and waited(lambda: not any(map(alive, others)), 10.0), "what it had started runs on"
    again = [*command, "--seconds", "12", "--resume", "learned"]
    done = subprocess.run(again, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    (before,) = map(int, re.findall(r"It goes on after (\d+) steps", done.stdout))
    assert done.returncode == 0 and before >= 100, done.stdout + done.stderr
    assert re.search(r"12\.0 s: +-?\d", done.stdout), "seconds count what was walked before"


@pytest.fixture
def enter(monkeypatch):
    """A terminal in place of the standard input; called, somebody presses Enter there."""
    master, slave = os.openpty()
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        yield lambda: os.write(master, b"\n")
    os.close(master)


def learning(folder: Path, stop) -> Learning:
    policy = pretrained.load("atlas", task="x", damage="healthy")
    course = Course(policy, folder)
    made = Learning(Arguments(), policy, course, None, "", None, stop)  # nobody learns here
    made.key = Key()
    return made


def test_whoever_has_laid_a_robot_on_its_belly_presses_enter(enter, tmp_path, capsys):
    own = learning(tmp_path, lambda: False)
    began = time.monotonic()
    threading.Timer(0.2, enter).start()
    own.right()
    assert time.monotonic() - began >= 0.2 and "Lay it on its belly, and press Enter" in capsys.readouterr().out
    assert not own.key(), "it is pressed once"


def test_who_does_not_may_stop(enter, tmp_path):
    with pytest.raises(StoppedError):
        learning(tmp_path, lambda: True).right()


def test_the_key_that_nobody_can_press_is_never_pressed(monkeypatch, tmp_path):
    (tmp_path / "no-terminal").write_text("\n")
    with (tmp_path / "no-terminal").open() as file:
        monkeypatch.setattr(sys, "stdin", file)
        assert not Key()()
