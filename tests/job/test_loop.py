"""A whole run: its files, what is taught and broken on the way, and lanes that are trained in waves."""

import csv
import dataclasses
import json
import shutil

import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.job import memory, plan
from srl_jax.job.run import run
from srl_jax.program.settings import EvaluationConfig
from tests.job.finished import numbers

FILES = {
    "config.json",
    "lanes.csv",
    "metrics.csv",
    "summary.json",
    "curves.png",
    "checkpoints",
    "videos",
    "report.html",
}


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


def test_learned_behaviour_growing_damage_and_a_diverging_lane(tmp_path):
    base = preset("smoke")
    config = dataclasses.replace(
        base,
        seeds="1",
        algos="tripod,srl",
        steps=400,
        behaviour="train",
        damage_schedule="healthy@0,leg_rm@200",
        train=dataclasses.replace(base.train, evaluate_every=200, checkpoint_every=400),
        evaluation=EvaluationConfig(episodes=2),
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
    assert stages == {"0", "200"}, "pi_B is measured under every stage of the damage"
    tripod, learned = (found["0", lane, "healthy/return"] for lane in ("0", "1"))
    assert tripod != learned, "the tripod's own healthy robot walks by the tripod"
    assert found["0", "0", "reference/return"] == found["0", "1", "reference/return"] == tripod


@pytest.mark.slow
def test_lanes_that_do_not_fit_are_trained_in_waves(smoke_run, tmp_path):
    base = preset("smoke")
    short = dataclasses.replace(base.train, evaluate_every=160, checkpoint_every=160)
    config = dataclasses.replace(base, steps=160, train=short)
    half = [lane for lane in plan.make(config).lanes if lane.seed == 0]
    config = dataclasses.replace(config, memory_gb=sum(memory.needed(config, half, 1)) / 2**30)
    notes, directory = [], tmp_path / "waves"
    summary = run(config, directory, 1, listener=lambda status: notes.append(status.note))
    assert summary is not None and "in 2 waves of 2 lanes" in notes[0]
    assert summary["machine"]["waves"] == 2 and summary["machine"]["lanes"] == 4
    assert "<dt>Waves</dt><dd>2</dd>" in (directory / "report.html").read_text()
    ours, theirs = numbers(directory), numbers(smoke_run[0])
    begun = {key: value for key, value in theirs.items() if key[0] == "0"}
    assert begun.keys() <= ours.keys() and len(ours) > len(begun)
    for key, value in begun.items():  # later, other widths round differently, and robots part
        np.testing.assert_allclose(ours[key], value, rtol=1e-3, atol=1e-3, err_msg=str(key))
    shutil.rmtree(directory / "wave-2")
    (directory / "summary.json").unlink()
    again = run(config, directory, 1, resume=True)
    assert again is not None
    np.testing.assert_equal(numbers(directory), ours)  # NaN where no episode has ended yet
