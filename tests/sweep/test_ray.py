"""The engine of Ray without Ray: what one of its workers does with a task."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from srl_jax import machine
from srl_jax.sweep import ray, task

TASK = "import os, time; from srl_jax.sweep import task; task.follow(); print(os.getpid(), flush=True); time.sleep(60)"
WORKER = f"""
import sys
from srl_jax.sweep import ray, task
task.command = lambda *_: [sys.executable, "-c", {TASK!r}]
ray.work("nowhere", 0, 1)
"""


def lives(process: Path) -> bool:
    """Whether a process is there and has not ended; a dead one waits for init to look."""
    try:
        return "State:\tZ" not in (process / "status").read_text()
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux kills a process with its parent")
def test_a_task_dies_with_its_worker():
    with subprocess.Popen([sys.executable, "-c", WORKER], stdout=subprocess.PIPE, text=True) as worker:
        child = Path("/proc") / next(iter(worker.stdout or ())).strip()
        assert lives(child)
        os.kill(worker.pid, signal.SIGKILL)
    until = time.monotonic() + 10
    while lives(child):
        assert time.monotonic() < until, "it went on, and the pack was in use for whoever tried again"
        time.sleep(0.02)


def test_what_may_succeed_is_raised_so_that_ray_tries_again(monkeypatch):
    end = lambda code: lambda *_: [sys.executable, "-c", f"raise SystemExit({code})"]  # noqa: E731
    for code in (task.DONE, task.USAGE):
        monkeypatch.setattr(task, "command", end(code))
        assert ray.work("nowhere", 0, 1) == code
    monkeypatch.setattr(task, "command", end(1))
    with pytest.raises(RuntimeError, match="pack 0 ended with code 1"):
        ray.work("nowhere", 0, 1)


def test_a_pack_in_use_is_waited_for(monkeypatch):
    codes = [task.IN_USE, task.IN_USE, task.DONE]
    monkeypatch.setattr(ray, "PAUSE", 0.01)
    monkeypatch.setattr(ray, "_once", lambda *_: codes.pop(0))
    assert ray.work("nowhere", 0, 1) == task.DONE and codes == []


def test_tasks_of_a_node_have_cores_of_their_own():
    cores = machine.cores()
    with ray.own_cores(cores) as whole, ray.own_cores(cores) as none_left:
        assert len(whole) == cores and none_left == set()
