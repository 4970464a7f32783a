"""An algorithm from outside the package runs by its name, with its own options, and its run can be read again."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from srl_jax.job import files
from srl_jax.report.data import read_metrics

ROOT = Path(__file__).parents[2]
SHORT = (
    "--preset smoke --seeds 1 --steps 40 --env.episode-steps 10 --train.evaluate-every 40 --train.checkpoint-every 40"
)
OWN = "--algos still --still.size 0.1,0.9 --still.joint 2"


def command(out, words):
    return subprocess.run(
        [sys.executable, "-m", "tests.job.still", str(out), *words.split()], cwd=ROOT, capture_output=True, text=True
    )


def test_it_runs_by_its_name(tmp_path):
    out = tmp_path / "run"
    done = command(out, f"{SHORT} {OWN}")
    assert done.returncode == 0, done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["methods"]) == {"still size=0.1", "still size=0.9"}
    assert not summary["nonfinite_lanes"]
    earned = read_metrics(out).last("train/return")
    assert earned[0] != earned[1]  # each variant acts by its own value

    settings = {"size": [0.1, 0.9], "joint": 2}
    assert json.loads((out / "config.json").read_text())["config"]["more"] == {"still": settings}
    printed = json.loads(done.stdout.splitlines()[-1])
    assert printed["more"] == {"still": settings}
    assert printed["actions"] == [[0.0, 0.25, *[0.0] * 16]] * 2
    with pytest.raises(ValueError, match="algos has 'still': choose from"):  # here nobody has registered it
        files.read_config(out)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--algos still --still.joint 0", "still.joint is 0: it must be at least 1."),
        ("--algos still --still.size=-0.1,0.2", "still.size is -0.1,0.2: it must not be negative."),
    ],
)
def test_its_ranges_are_checked_as_those_that_ship(words, message, tmp_path):
    done = command(tmp_path / "run", words)
    assert done.returncode == 2 and message in done.stderr
    assert not (tmp_path / "run").exists()
