"""A whole run: its files, and that it resumes to the same numbers however it ended and on whatever devices."""

import csv
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

FILES = {"config.json", "lanes.csv", "metrics.csv", "summary.json", "curves.png", "checkpoints", "videos"}
PYTHON = [sys.executable, "-m", "srl_jax.run"]
COMMAND = [*PYTHON, "--preset", "smoke", "--devices", "2", "--out"]


def results(directory: Path):
    """What must not depend on interruptions: the metrics, and the summary without what was timed."""
    summary = json.loads((directory / "summary.json").read_text())
    del summary["machine"]
    return (directory / "metrics.csv").read_text(), summary


def numbers(directory: Path) -> dict[tuple, float]:
    """metrics.csv as (step, lane, metric) -> value."""
    with (directory / "metrics.csv").open(newline="") as file:
        return {(r["step"], r["lane"], r["metric"]): float(r["value"]) for r in csv.DictReader(file)}


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


def killed_when(condition, directory: Path) -> None:
    """A run of the command line that is killed without warning at the moment that is asked for."""
    with subprocess.Popen([*COMMAND, str(directory)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        wait_for(condition, process)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not (directory / "summary.json").exists()


def test_a_run_leaves_its_files(smoke_run):
    directory, summary, _ = smoke_run
    assert {path.name for path in directory.iterdir() if not path.name.startswith(".")} == FILES
    assert set(summary["methods"]) == {"ddpg", "srl"}
    assert summary["machine"]["lanes"] == 4 and summary["machine"]["environment_steps_per_second"] > 0
    with (directory / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    prefixes = {row["metric"].partition("/")[0] for row in rows}
    assert prefixes == {"healthy", "reference", "teacher", "eval", "train"}
    assert {int(row["step"]) for row in rows if row["metric"] == "eval/return"} == {0, 800, 1600}
    assert all(np.isfinite(float(row["value"])) for row in rows if not row["metric"].startswith("train/"))
    assert list((directory / "videos").glob("*.mp4"))


def test_one_program_is_traced_once(smoke_run):
    # lax.scan and vmap call the step's Python once per trace of the chunk; C rollouts for videos do not call it.
    assert smoke_run[2] == 1


def test_a_killed_run_resumes_to_the_same_numbers(smoke_run, tmp_path):
    directory = tmp_path / "killed"
    killed_when(lambda: list(directory.glob("checkpoints/[0-9]*")), directory)
    resume(directory)
    assert results(directory) == results(smoke_run[0])


def test_a_terminated_run_saves_and_says_how_to_go_on(smoke_run, tmp_path):
    directory = tmp_path / "terminated"
    command = [*COMMAND, str(directory)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        wait_for(lambda: (directory / "metrics.csv").exists(), process)
        process.send_signal(signal.SIGTERM)
        printed = process.communicate()[0]
    assert process.returncode == 128 + signal.SIGTERM, printed
    assert f"--resume {directory}" in printed
    resume(directory)
    assert results(directory) == results(smoke_run[0])


def test_a_run_killed_while_videos_are_drawn_only_draws_them_again(smoke_run, tmp_path):
    directory = tmp_path / "drawing"
    killed_when(lambda: (directory / "videos").exists() and (directory / "checkpoints" / "1600").exists(), directory)
    resume(directory)
    assert results(directory) == results(smoke_run[0])
    machine = json.loads((directory / "summary.json").read_text())["machine"]
    assert machine["training_seconds"] > 0.0, "the totals of the first part are kept"
    assert machine["environment_steps_per_second"] > 0
    names = [{path.name for path in (d / "videos").iterdir()} for d in (directory, smoke_run[0])]
    assert names[0] == names[1]


def test_a_run_goes_on_with_another_number_of_devices(tmp_path):
    """Begun on two devices, stopped at its checkpoint, finished on one, which rounds otherwise."""
    base = preset("smoke")
    often = dataclasses.replace(base.train, evaluate_every=160, checkpoint_every=160)
    config, whole, moved = dataclasses.replace(base, steps=320, train=often), tmp_path / "whole", tmp_path / "moved"
    assert run(config, whole, 2) is not None
    assert run(config, moved, 2, stopped=lambda: (moved / "checkpoints" / "160").exists()) is None
    resume(moved, "--devices", "1")
    ours, theirs = numbers(moved), numbers(whole)
    assert ours.keys() == theirs.keys()
    later = [key for key in theirs if key[0] == "320" and np.isfinite(theirs[key])]
    assert any(metric == "train/critic_loss" for _, _, metric in later), "it learned after it had moved"
    for key in later:
        np.testing.assert_allclose(ours[key], theirs[key], rtol=1e-3, atol=1e-4, err_msg=str(key))
    parts = json.loads((moved / "config.json").read_text())["parts"]
    assert [part["devices"] for part in parts] == [2, 1] and parts[1]["from_step"] >= 160


def test_learned_behaviour_growing_damage_and_a_diverging_lane(tmp_path):
    base = preset("smoke")
    config = dataclasses.replace(
        base,
        seeds="1",
        algos="tripod,srl",
        steps=800,
        behaviour="train",
        damage_schedule="healthy@0,leg_rm@400",
        train=dataclasses.replace(base.train, evaluate_every=400),
        srl=dataclasses.replace(base.srl, critic_lr=(1e-3, 1e38)),
    )
    directory = tmp_path / "run"
    summary = run(config, directory, 2)
    assert summary is not None
    assert json.loads((directory / "behaviour" / "summary.json").read_text())["task"] == "p2p"
    assert [lane["variant"] for lane in summary["nonfinite_lanes"]] == ["critic_lr=1e+38"]
    good = summary["methods"]["srl critic_lr=0.001"]["overall"]
    assert all(value is not None for value in good["return"].values())
    assert list((directory / "videos").glob("*-leg_rm-*.mp4"))
    found = numbers(directory)
    stages = {step for step, _, metric in found if metric == "teacher/return"}
    assert stages == {"0", "400"}, "pi_B is measured under every stage of the damage"
    tripod, learned = (found["0", lane, "healthy/return"] for lane in ("0", "1"))
    assert tripod != learned, "the tripod's own healthy robot walks by the tripod"
    assert found["0", "0", "reference/return"] == found["0", "1", "reference/return"] == tripod


def test_lanes_that_do_not_fit_are_trained_in_waves(smoke_run, tmp_path, monkeypatch):
    from srl_jax.job import memory

    base = memory.needed(preset("smoke"), [], 2)
    assert sum(base) == memory.BASE
    config = dataclasses.replace(preset("smoke"), memory_gb=(memory.BASE + 6 * 2**20) / 2**30)
    notes = []
    directory = tmp_path / "waves"
    summary = run(config, directory, 2, listener=lambda status: notes.append(status.note))
    assert summary is not None and "in 2 waves of 2 lanes" in notes[0]
    assert summary["machine"]["waves"] == 2 and summary["machine"]["lanes"] == 4
    ours, theirs = numbers(directory), numbers(smoke_run[0])
    assert ours.keys() == theirs.keys()
    for key, value in theirs.items():
        if key[0] == "0":  # later, other widths round differently, and robots part
            np.testing.assert_allclose(ours[key], value, rtol=1e-3, atol=1e-3, err_msg=str(key))
    shutil.rmtree(directory / "wave-2")
    (directory / "summary.json").unlink()
    again = run(config, directory, 2, resume=True)
    assert again is not None and numbers(directory) == ours


def test_a_truncated_checkpoint_is_one_sentence(smoke_run, tmp_path):
    copy = shutil.copytree(smoke_run[0], tmp_path / "copy")
    for path in (copy / "checkpoints").rglob("*"):
        if path.is_file() and path.stat().st_size > 1_000:
            os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(ValueError, match="cannot be read"):
        run(preset("smoke"), copy, 2, resume=True)
