"""A run resumes to the same numbers however it ended, by the command line and on whatever devices."""

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.job.run import run
from tests.job.finished import numbers, results

PYTHON = [sys.executable, "-m", "srl_jax.run"]
COMMAND = [*PYTHON, "--preset", "smoke", "--devices", "2", "--out"]


@pytest.fixture(autouse=True)
def own_threads(monkeypatch):
    """Every command sizes XLA's pool itself: as many threads as devices, where the tests here have one to spare."""
    monkeypatch.delenv("NPROC")


def resume(directory: Path, *arguments: str) -> None:
    """Goes on by the command line, as the closing line of a stopped run says."""
    done = subprocess.run([*PYTHON, "--resume", str(directory), *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def wait_for(condition, process, seconds=400):
    begin = time.monotonic()
    while not condition():
        assert process.poll() is None, process.stderr.read() if process.stderr else "ended early"
        assert time.monotonic() - begin < seconds
        time.sleep(0.05)


def killed_when(condition, command: list[str]) -> None:
    """A run of the command line that is killed without warning at the moment that is asked for."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        wait_for(condition, process)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL


def test_a_run_that_is_killed_twice_resumes_to_the_same_numbers(smoke_run, tmp_path):
    """After its first checkpoint, and once more while videos are drawn: then only they are drawn again."""
    directory = tmp_path / "killed"
    killed_when(lambda: list(directory.glob("checkpoints/[0-9]*")), [*COMMAND, str(directory)])
    saved = directory / "checkpoints" / "1600"
    killed_when(lambda: saved.exists() and (directory / "videos").exists(), [*PYTHON, "--resume", str(directory)])
    assert not (directory / "summary.json").exists()
    resume(directory)
    assert results(directory) == results(smoke_run[0])
    machine = json.loads((directory / "summary.json").read_text())["machine"]
    kept = machine["training_seconds"], machine["environment_steps_per_second"]
    assert min(kept) > 0.0, "the last process did not train: its totals are those of the earlier ones"
    names = [{path.name for path in (d / "videos").iterdir()} for d in (directory, smoke_run[0])]
    assert names[0] == names[1]


def test_a_terminated_run_saves_and_says_how_to_go_on(tmp_path):
    directory = tmp_path / "terminated"
    command = [*COMMAND, str(directory)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        wait_for(lambda: (directory / "metrics.csv").exists(), process)
        process.send_signal(signal.SIGTERM)
        printed = process.communicate()[0]
    assert process.returncode == 128 + signal.SIGTERM, printed
    assert f"--resume {directory}" in printed


@pytest.mark.slow
def test_a_run_goes_on_with_another_number_of_devices(tmp_path):
    """Begun on two devices, stopped, finished on one; that no bit is lost on the way: test_checkpoint."""
    base = preset("smoke")
    often = dataclasses.replace(base.train, evaluate_every=160, checkpoint_every=160)
    config, moved = dataclasses.replace(base, steps=320, train=often), tmp_path / "moved"
    seen: list[int] = []
    stopped = lambda: bool(seen) and seen[-1] >= 160  # noqa: E731
    assert run(config, moved, 2, listener=lambda status: seen.append(status.step), stopped=stopped) is None
    resume(moved, "--devices", "1")
    found = numbers(moved)
    judged = {key: value for key, value in found.items() if key[0] == "320"}
    assert {metric for _, _, metric in judged} >= {"eval/return", "train/critic_loss"}, "it learned after it had moved"
    known = [value for (_, _, metric), value in judged.items() if metric.startswith("eval/") or "critic" in metric]
    assert np.isfinite(known).all()
    assert len({key for key in judged if key[2] == "eval/return"}) == 4
    parts = json.loads((moved / "config.json").read_text())["parts"]
    assert [part["devices"] for part in parts] == [2, 1] and parts[1]["from_step"] >= 160


def test_a_truncated_checkpoint_is_one_sentence(smoke_run, tmp_path):
    copy = shutil.copytree(smoke_run[0], tmp_path / "copy")
    for path in (copy / "checkpoints").rglob("*"):
        if path.is_file() and path.stat().st_size > 1_000:
            os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(ValueError, match="cannot be read"):
        run(preset("smoke"), copy, 2, resume=True)
