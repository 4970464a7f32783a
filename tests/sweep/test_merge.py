"""Merging: one directory as if one run had made it, whatever is missing, and the same however often."""

import dataclasses

import pytest

from srl_jax.agents.settings import SRLConfig
from srl_jax.job import page, plan
from srl_jax.job.command import again
from srl_jax.report.data import read_metrics
from srl_jax.report.page import render
from srl_jax.sweep import attempts, lease, merge
from tests.sweep import packs

NARROW = {"ddpg": dataclasses.replace(packs.BASE.ddpg, hidden=(16,))}


def contents(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir() if path.suffix != ".png"}


def test_all_packs_make_one_run(tmp_path):
    sweep = packs.planned(tmp_path / "s")
    for number in reversed(range(len(sweep))):
        packs.finish(sweep, number)
    summary = merge.merge(sweep)
    assert summary["sweep"]["complete"] and summary["sweep"]["missing"] == [] and len(sweep) == 3
    assert summary["machine"] == packs.MACHINE | {"lanes": 12, "training_seconds": 6.0, "compile_seconds": 9.0}
    run = read_metrics(tmp_path / "s" / "merged")
    whole = plan.make(packs.BASE).lanes
    assert [lane["lane"] for lane in sorted(run.lanes, key=lambda lane: lane["lane"])] == [x.index for x in whole]
    assert run.last("eval/return") == {lane.index: packs.value(lane, 1600) for lane in whole}
    assert (tmp_path / "s" / "merged" / "curves.png").stat().st_size > 10_000
    assert not (tmp_path / "s" / "merged" / "sensitivity.png").exists()
    assert "<h1>s</h1>" in (tmp_path / "s" / "merged" / "report.html").read_text()
    before = contents(tmp_path / "s" / "merged")
    merge.merge(sweep)
    assert contents(tmp_path / "s" / "merged") == before
    assert not (tmp_path / "s" / "merged.partial").exists()


def test_what_is_missing_is_named_and_added_later(tmp_path):
    sweep = packs.planned(tmp_path / "s")
    for number in (0, 2):
        packs.finish(sweep, number)
    attempts.begin(sweep.pack(1).task)
    attempts.end(sweep.pack(1).task, 1, "OSError: no space")
    summary = merge.merge(sweep)
    about = summary["sweep"]
    assert "2 of 3 packs are done" in (tmp_path / "s" / "merged" / "report.html").read_text()
    assert not about["complete"] and about["merged"] == 2
    assert [(x["pack"], x["state"], x["error"]) for x in about["missing"]] == [(1, "failed", "OSError: no space")]
    assert about["left_out"] and all("lanes that there are fill a table" in line for line in about["left_out"])
    assert len(read_metrics(tmp_path / "s" / "merged").lanes) == 8, "the files have all that there is"
    packs.finish(sweep, 1)
    assert merge.merge(sweep)["sweep"]["complete"]
    assert len(read_metrics(tmp_path / "s" / "merged").lanes) == 12


def test_nothing_to_merge(tmp_path):
    with pytest.raises(ValueError, match="nothing to merge yet: none of its 3 packs is done"):
        merge.merge(packs.planned(tmp_path / "s"))


def test_a_lane_that_failed_is_named(tmp_path):
    sweep = packs.planned(tmp_path / "s")
    for number in range(3):
        packs.finish(sweep, number, broken=number == 1)
    summary = merge.merge(sweep)
    assert len(summary["nonfinite_lanes"]) == 1 and not summary["sweep"]["complete"]


def test_points_of_a_grid_are_methods_of_their_own(tmp_path):
    grid = (("ddpg.hidden=32,32", {}), ("ddpg.hidden=16", NARROW))
    sweep = packs.planned(tmp_path / "s", 12, grid)
    for number in range(len(sweep)):
        packs.finish(sweep, number)
    summary = merge.merge(sweep)
    assert list(summary["methods"]) == [
        f"{algo} ddpg.hidden={width}" for width in ("32,32", "16") for algo in ("ddpg", "srl")
    ]
    run = read_metrics(tmp_path / "s" / "merged")
    assert sorted(lane["lane"] for lane in run.lanes) == list(range(24))
    last = run.last("eval/return")
    assert last[12] == packs.value(plan.make(packs.BASE).lanes[0], 1600, point=1)
    found = {(x["algo"], x["value"]): x["iqm"] for x in summary["sweep"]["sensitivity"]}
    assert found["ddpg", "16"] > found["ddpg", "32,32"] + 900
    text = (tmp_path / "s" / "merged" / "report.html").read_text()
    assert all(again(point.config) in text and point.label in text for point in sweep.points)
    assert "What was swept" in text and render(page.of_run(tmp_path / "s" / "merged")) == text
    assert (tmp_path / "s" / "merged" / "sensitivity.png").exists()


def test_swept_values_get_a_table(tmp_path):
    sweep = packs.planned(tmp_path / "s", 18, srl=dataclasses.replace(packs.BASE.srl, guidance_weight=(4.0, 1.0)))
    packs.finish(sweep, 0)
    rows = merge.merge(sweep)["sweep"]["sensitivity"]
    assert [(x["algo"], x["setting"], x["value"], x["lanes"]) for x in rows] == [
        ("srl", "guidance_weight", "1", 6),
        ("srl", "guidance_weight", "4", 6),
    ]
    assert isinstance(packs.BASE.srl, SRLConfig) and all(x["low"] <= x["iqm"] <= x["high"] for x in rows)


def test_one_merge_at_a_time(tmp_path):
    sweep = packs.planned(tmp_path / "s")
    packs.finish(sweep, 0)
    with lease.held(tmp_path / "s" / "merge.lease", beat=0.05), pytest.raises(lease.HeldError, match="is in use by"):
        merge.merge(sweep)
    assert not (tmp_path / "s" / "merged").exists()
    merge.merge(sweep)
    assert (tmp_path / "s" / "merged").exists()
