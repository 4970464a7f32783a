"""The figure of three tasks, on runs that are finished or stand in for being trained."""

import subprocess

import pytest

from experiments import figure3
from tests.report.runs import write

METHODS = {("ddpg", ""): 0.2, ("srl", ""): 0.6}


def test_figure3_trains_what_is_missing_and_goes_on_with_what_is_unfinished(tmp_path, monkeypatch):
    commands = []

    def trained(words):
        commands.append(words[1:])
        task = words[words.index("--task") + 1] if "--task" in words else "xy"
        write(tmp_path / "runs" / task, task=task, methods=METHODS)
        return subprocess.CompletedProcess(words, 0)

    monkeypatch.setattr(subprocess, "run", trained)
    write(tmp_path / "runs", methods=METHODS)  # makes the folder
    write(tmp_path / "runs" / "x", task="x", methods=METHODS)
    (tmp_path / "runs" / "x" / "summary.json").write_text("{}")
    write(tmp_path / "runs" / "xy", task="xy", methods=METHODS)
    arguments = figure3.Arguments(runs=tmp_path / "runs", out=tmp_path / "docs" / "figure3.png", seeds="2")
    figure3.main(arguments, ["--preset", "smoke"])
    start = ["-m", "srl_jax.run"]
    new = ["--task", "p2p", "--seeds", "2", "--algos", "ddpg,srl", "--out", str(tmp_path / "runs" / "p2p")]
    assert commands == [[*start, "--resume", str(tmp_path / "runs" / "xy")], [*start, *new, "--preset", "smoke"]]
    assert arguments.out.stat().st_size > 10_000


def test_figure3_says_which_run_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(subprocess, "run", lambda words: subprocess.CompletedProcess(words, 2))
    with pytest.raises(ValueError, match=r"--task x .* did not finish"):
        figure3.main(figure3.Arguments(runs=tmp_path))
