"""A whole run: its files, that it resumes to the same numbers however it ended, and that bad input is one sentence."""

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from srl_jax.cli import run
from srl_jax.config import preset
from srl_jax.env import hexapod
from srl_jax.job import loop

FILES = {"config.json", "lanes.csv", "metrics.csv", "summary.json", "curves.png", "checkpoints", "videos"}
COMMAND = [sys.executable, "-m", "srl_jax.run", "--preset", "smoke", "--devices", "2", "--out"]


def results(directory: Path):
    """What must not depend on interruptions: the metrics, and the summary without what was timed."""
    summary = json.loads((directory / "summary.json").read_text())
    del summary["machine"]
    return (directory / "metrics.csv").read_text(), summary


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """An uninterrupted smoke run, and how often its physics was traced."""
    directory, traces = tmp_path_factory.mktemp("run") / "whole", []
    step = hexapod.step
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hexapod, "step", lambda *args: (traces.append(1), step(*args))[1])
        summary = loop.run(preset("smoke"), directory, 2)
    return directory, summary, len(traces)


def test_a_run_leaves_its_files(finished):
    directory, summary, _ = finished
    assert {path.name for path in directory.iterdir() if not path.name.startswith(".")} == FILES
    assert set(summary["methods"]) == {"ddpg", "srl"}
    assert summary["machine"]["lanes"] == 4
    rows = (directory / "metrics.csv").read_text().splitlines()
    assert rows[0] == "step,lane,metric,value"
    steps = {int(row.split(",")[0]) for row in rows[1:] if "eval/return" in row}
    assert steps == {0, 800, 1600}
    assert list((directory / "videos").glob("*.mp4"))


def test_one_program_is_traced_once(finished):
    # lax.scan and vmap call the step's Python once per trace of the chunk; C rollouts for videos do not call it.
    assert finished[2] == 1


def test_a_killed_run_resumes_to_the_same_numbers(finished, tmp_path):
    directory = tmp_path / "killed"
    with subprocess.Popen([*COMMAND, str(directory)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        wait_for(lambda: list(directory.glob("checkpoints/[0-9]*")), process)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not (directory / "summary.json").exists()
    loop.run(preset("smoke"), directory, 2, resume=True)
    assert results(directory) == results(finished[0])


def test_a_terminated_run_saves_and_says_how_to_go_on(finished, tmp_path):
    directory = tmp_path / "terminated"
    command = [*COMMAND, str(directory)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        wait_for(lambda: (directory / "metrics.csv").exists(), process)
        process.send_signal(signal.SIGTERM)
        printed = process.communicate()[0]
    assert process.returncode == 128 + signal.SIGTERM, printed
    assert f"--resume {directory}" in printed
    loop.run(preset("smoke"), directory, 2, resume=True)
    assert results(directory) == results(finished[0])


def test_learned_behaviour_growing_damage_and_a_diverging_lane(tmp_path):
    base = preset("smoke")
    config = dataclasses.replace(
        base,
        seeds="1",
        algos="srl",
        steps=800,
        behaviour="train",
        damage_schedule="healthy@0,leg_rm@400",
        train=dataclasses.replace(base.train, evaluate_every=400),
        srl=dataclasses.replace(base.srl, critic_lr=(1e-3, 1e38)),
    )
    summary = loop.run(config, tmp_path / "run", 2)
    assert json.loads((tmp_path / "run" / "behaviour" / "summary.json").read_text())["task"] == "p2p"
    assert [lane["variant"] for lane in summary["nonfinite_lanes"]] == ["critic_lr=1e+38"]
    good = summary["methods"]["srl critic_lr=0.001"]["overall"]
    assert all(value is not None for value in good["return"].values())
    assert list((tmp_path / "run" / "videos").glob("*-leg_rm-*.mp4"))


def wait_for(condition, process, seconds=300):
    begin = time.monotonic()
    while not condition():
        assert process.poll() is None, process.stderr.read() if process.stderr else "ended early"
        assert time.monotonic() - begin < seconds
        time.sleep(0.05)


def sentence(capsys, monkeypatch, *arguments):
    """The one line on stderr of a command that is refused."""
    monkeypatch.setattr(run, "use_devices", lambda wanted: 2)
    with pytest.raises(SystemExit) as caught:
        run.main(list(arguments))
    assert caught.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


REFUSED = [
    (["--algos", "dqn"], "algos is 'dqn'"),
    (["--damage", "leg_zz"], "leg_zz"),
    (["--memory-gb", "0.5"], "memory_gb is 0.5"),
    (["--behaviour", "nowhere"], "behaviour is 'nowhere'"),
    (["--seeds", "0"], "seeds is '0'"),
]


@pytest.mark.parametrize("arguments, message", REFUSED)
def test_refused_before_anything_is_written(arguments, message, capsys, monkeypatch, tmp_path):
    out = tmp_path / "out"
    assert message in sentence(capsys, monkeypatch, *arguments, "--out", str(out))
    assert not out.exists()


def test_a_directory_in_use_is_refused(finished, capsys, monkeypatch):
    assert "is not empty" in sentence(capsys, monkeypatch, "--out", str(finished[0]))


def test_resuming_with_other_settings_names_them(finished, capsys, monkeypatch):
    line = sentence(capsys, monkeypatch, "--resume", str(finished[0]), "--srl.dropout", "0.5", "--steps", "3200")
    assert "srl.dropout" in line and "steps" in line


def test_resuming_what_is_no_run(capsys, monkeypatch, tmp_path):
    assert "no config.json" in sentence(capsys, monkeypatch, "--resume", str(tmp_path))


def test_a_truncated_checkpoint_is_one_sentence(finished, capsys, monkeypatch, tmp_path):
    copy = shutil.copytree(finished[0], tmp_path / "copy")
    for path in (copy / "checkpoints").rglob("*"):
        if path.is_file() and path.stat().st_size > 1_000:
            os.truncate(path, path.stat().st_size // 2)
    assert "cannot be read" in sentence(capsys, monkeypatch, "--resume", str(copy))


def test_a_full_disk_is_one_sentence(capsys, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device", str(tmp_path / "out" / "config.json"))

    monkeypatch.setattr(loop.output, "write_config", full)
    assert "No space left" in sentence(capsys, monkeypatch, "--preset", "smoke", "--out", str(tmp_path / "out"))


def test_help_answers_without_jax():
    code = """
import sys
from srl_jax.cli import run
try:
    run.main(["--help"])
except SystemExit:
    assert "jax" not in sys.modules
"""
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "--damage-schedule" in printed and "--srl.dropout" in printed
