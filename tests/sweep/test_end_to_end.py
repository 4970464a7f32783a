"""A sweep by the command line, one of whose tasks is killed: the same numbers as its packs have as plain runs."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from srl_jax.cli import pack as task
from srl_jax.job.run import run
from srl_jax.sweep import attempts, lease, manifest
from tests.job.finished import numbers, results
from tests.sweep import packs

pytestmark = pytest.mark.slow  # tests/cluster/slurm.sh kills and compares in less time
SWEEP = [sys.executable, "-m", "srl_jax.sweep"]
OPTIONS = ["--preset", "smoke", "--algos", "ddpg", "--seeds", "4"]  # compiles fastest
OPTIONS += ["--steps", "480", "--train.evaluate-every", "160", "--train.checkpoint-every", "160"]


def task_of(number: int) -> int | None:
    """The process that works on a pack."""
    wanted = f"--run-pack\0{number}\0"
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if path.read_text().endswith(wanted):
                return int(path.parent.name)
        except OSError:
            continue
    return None


def kill_once(directory: Path, killed: list[int]) -> None:
    """Kills the task of pack 0 as soon as it has a checkpoint."""
    until = time.monotonic() + 300
    while time.monotonic() < until:
        if list((directory / "packs" / "00000").glob("checkpoints/[0-9]*")) and (pid := task_of(0)):
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)
            return
        time.sleep(0.01)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep of two packs, the first of which was killed on its way, as the command left it."""
    directory, killed = tmp_path_factory.mktemp("sweep") / "s", []
    command = [*SWEEP, *OPTIONS, "--pack-lanes", "2", "--cpus", "1", "--out", str(directory)]
    killer = threading.Thread(target=kill_once, args=(directory, killed))
    killer.start()
    done = subprocess.run(command, capture_output=True, text=True)
    killer.join()
    assert killed, done.stdout + done.stderr
    return directory, done


def test_a_killed_pack_is_begun_again_and_all_are_merged(swept):
    directory, done = swept
    assert done.returncode == 0, done.stdout + done.stderr
    assert "pack 00000 ended with code -9" in done.stdout and "pack 00000 done" in done.stdout
    assert "2 of 2 packs merged" in done.stdout
    lines = attempts.read(directory / "tasks" / "00000")
    assert sum("host" in line for line in lines) == 2 and lines[-1]["exit"] == 0
    summary = json.loads((directory / "merged" / "summary.json").read_text())
    assert summary["sweep"]["complete"] and list(summary["methods"]) == ["ddpg"]
    assert len({lane for _, lane, _ in numbers(directory / "merged")}) == 4


def test_its_numbers_are_those_of_a_plain_run(swept, tmp_path):
    killed, plain = manifest.read(swept[0]).pack(0), tmp_path / "plain"
    assert run(killed.config, plain, 1) is not None
    assert results(plain) == results(killed.directory)


def test_what_is_done_is_left_at_once(swept):
    directory, _ = swept
    assert task.run_pack(manifest.read(directory), 0) == 0
    assert len(attempts.read(directory / "tasks" / "00000")) == 3, "no attempt was begun"


def test_a_pack_in_use_is_left_to_whoever_has_it(tmp_path, capsys, monkeypatch):
    sweep = packs.planned(tmp_path / "s")
    monkeypatch.setattr(lease.held.__wrapped__, "__kwdefaults__", {"beat": 0.05, "patience": 0.5})
    with lease.held(sweep.pack(1).task / attempts.LEASE):
        assert task.run_pack(sweep, 1) == 75
    assert "is in use by" in capsys.readouterr().err
    assert attempts.read(sweep.pack(1).task) == []


def test_a_pack_that_cannot_be_done_says_why(tmp_path, monkeypatch):
    sweep = packs.planned(tmp_path / "s")
    full = OSError(28, "No space left on device", "x.csv")
    monkeypatch.setattr(task, "_work", lambda *_: (_ for _ in ()).throw(full))
    assert task.run_pack(sweep, 0) == 1
    found = attempts.fate(sweep.pack(0))
    assert (found.state, found.error) == ("failed", "No space left on device: x.csv.")
    monkeypatch.setattr(task, "_work", lambda *_: (_ for _ in ()).throw(ValueError("memory_gb is 0.1")))
    with pytest.raises(ValueError, match="memory_gb"):
        task.run_pack(sweep, 1)
    assert attempts.read(sweep.pack(1).task)[-1]["exit"] == 2


def test_a_task_that_was_killed_before_it_wrote_anything_can_be_begun_again(tmp_path, monkeypatch):
    sweep = packs.planned(tmp_path / "s")
    (sweep.pack(0).directory).mkdir(parents=True)
    (sweep.pack(0).directory / ".lock").touch()
    monkeypatch.setattr(task, "_use_cache", lambda folder: folder.mkdir(parents=True, exist_ok=True))
    monkeypatch.setattr(task, "StopSignals", lambda: None)
    asked = []
    monkeypatch.setattr("srl_jax.job.run.run", lambda *_, **options: asked.append(options["resume"]) or {})
    assert task.run_pack(sweep, 0) == 0 and task.run_pack(sweep, 1) == 0
    assert asked == [True, False], "a new run would refuse the directory, as bad input, and never be tried again"


def test_a_disk_too_full_for_a_lease_is_no_bad_input(tmp_path, monkeypatch, capsys):
    sweep = packs.planned(tmp_path / "s")
    full = OSError(28, "No space left on device", "lease")
    monkeypatch.setattr(lease, "acquire", lambda *_: (_ for _ in ()).throw(full))
    assert task.run_pack(sweep, 0) == 1, "2 would not be tried again"
    assert "No space left on device: lease." in capsys.readouterr().err
