"""The summary of a synthetic run gives back what was put in, and no method's numbers depend on its neighbours."""

import json

import numpy as np
import pytest

from srl_jax import statistics
from srl_jax.report.data import Group, read_metrics
from srl_jax.report.summary import lane_scores, summarise
from tests.report.runs import failing, scaled, write

SRL = Group("srl", "")


def test_summary_holds_what_was_put_in(tmp_path):
    summary = summarise(read_metrics(write(tmp_path)))
    json.dumps(summary, allow_nan=False)
    assert summary["healthy"] == pytest.approx({"return": 49.5, "success": 0.9, "distance": 1.6})
    assert summary["reference"] == pytest.approx({"return": 60.0, "success": 1.0, "distance": 2.0})
    assert (summary["task"], summary["steps"], summary["nonfinite_lanes"]) == ("p2p", 300, [])
    assert summary["finish"] == pytest.approx(0.9 * 49.5)
    srl, ddpg = summary["methods"]["srl"], summary["methods"]["ddpg"]
    end = 0.5 + 0.045  # mean of .4 and .6, and the seeds' mean offset
    assert srl["overall"]["success"]["iqm"] == pytest.approx(end)
    assert srl["overall"]["return"]["iqm"] == pytest.approx(100 * end)
    assert srl["overall"]["retained"]["iqm"] == pytest.approx(2 * end / 2.0)
    assert srl["overall"]["retained_own"]["iqm"] == pytest.approx(2 * end / 1.6)
    assert srl["overall"]["area_success"]["iqm"] == pytest.approx(0.3 + 0.045)
    assert srl["overall"]["area_return"]["iqm"] == pytest.approx(30 + 4.5)
    assert srl["overall"]["fell"] == {"iqm": 0.25, "low": 0.25, "high": 0.25}
    assert srl["overall"]["teacher_success"]["iqm"] == pytest.approx(0.2)
    assert srl["conditions"]["leg 2"]["teacher_success"]["iqm"] == pytest.approx(0.3)
    # Seeds 5 and 6 reach 44.55 at step 200 (with 45 and 46), seeds 3 and 4 only at 300.
    assert srl["overall"]["steps_to_finish"]["iqm"] == pytest.approx(250)
    assert srl["overall"]["reached_finish"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert ddpg["overall"]["steps_to_finish"] == {"iqm": None, "low": None, "high": None}
    assert ddpg["overall"]["reached_finish"]["mean"] == 0.0
    low, high = (srl["overall"]["success"][key] for key in ("low", "high"))
    assert end - 0.015 < low < end < high < end + 0.015


def test_a_method_reads_the_same_whatever_ran_beside_it(tmp_path):
    # The tripod's pi_B is another one, walks twice as far and earns twice as much; one of its lanes explodes.
    beside = {("srl", ""): 0.6, ("tripod", ""): 0.3}
    odd = {lane: {"healthy/return": 2.0, "healthy/distance": 2.0, "eval/return": -3.0} for lane in range(12, 24)}
    alone = summarise(read_metrics(write(tmp_path / "alone", methods={("srl", ""): 0.6}, edit=failing({1}, since=200))))
    both = lambda rows: failing({1, 17}, since=200)(scaled(odd)(rows))  # noqa: E731
    joint = summarise(read_metrics(write(tmp_path / "joint", methods=beside, edit=both)))
    assert joint["methods"]["srl"] == alone["methods"]["srl"]
    assert joint["finish"] != alone["finish"]  # for display: the mean over all lanes


def test_a_lane_that_earned_nothing_healthy_never_finishes(tmp_path):
    run = read_metrics(write(tmp_path, edit=scaled({12: {"healthy/return": -1.0}})))
    scores = lane_scores(run, SRL)
    assert scores["steps_to_finish"][0, 0] == np.inf and np.isfinite(scores["steps_to_finish"]).sum() == 11
    assert summarise(run, 50)["methods"]["srl"]["overall"]["reached_finish"]["mean"] == pytest.approx(11 / 12)
    none = read_metrics(write(tmp_path, edit=scaled({i: {"healthy/return": 0.0} for i in range(36)})))
    assert "steps_to_finish" not in lane_scores(none, SRL)
    assert summarise(none, 50)["finish"] is None


def test_a_healthy_robot_that_went_backwards_has_no_ratio(tmp_path):
    overall = "overall"
    run = read_metrics(write(tmp_path, edit=scaled({12: {"healthy/distance": -1.0}})))
    srl = summarise(run, 50)["methods"]["srl"]
    assert "retained_own" not in srl[overall] and "retained_own" not in srl["conditions"]["leg 0"]
    assert srl[overall]["retained"]["iqm"] == pytest.approx(0.545)
    assert srl["conditions"]["leg 1"]["retained_own"]["iqm"] == pytest.approx(1.09 / 1.6)


def test_an_old_run_falls_back_to_its_own_healthy_policy(tmp_path):
    write(tmp_path, edit=lambda rows: [row for row in rows if not row[2].startswith("reference/")])
    summary = summarise(read_metrics(tmp_path), 50)
    overall = summary["methods"]["srl"]["overall"]
    assert overall["retained"] == overall["retained_own"]
    assert overall["retained"]["iqm"] == pytest.approx(1.09 / 1.6)
    assert summary["reference"]["distance"] is None


def test_run_without_behaviour_policy_leaves_its_numbers_out(tmp_path):
    write(tmp_path, edit=lambda rows: [row for row in rows if row[2].startswith(("eval/", "train/"))])
    summary = summarise(read_metrics(tmp_path), 50)
    assert summary["finish"] is None
    assert set(summary["methods"]["srl"]["overall"]) == {
        *("success", "return", "distance", "fell", "area_success", "area_return")
    }


def test_the_teacher_of_the_last_stage_counts(tmp_path):
    def staged(rows):
        return rows + [(150, i, m, 2 * x) for s, i, m, x in rows if m.startswith("teacher/")]

    overall = summarise(read_metrics(write(tmp_path, edit=staged)), 50)["methods"]["srl"]["overall"]
    assert overall["teacher_success"]["iqm"] == pytest.approx(0.4)
    assert overall["teacher_return"]["iqm"] == pytest.approx(24.0)


def test_a_total_is_the_last_that_a_lane_has_shown(tmp_path):
    def totals(rows):
        found = [(s, i, "gauge/trial_seconds", s / 10 + i) for s in (100, 200, 300) for i in range(12, 24)]
        return rows + [(s, i, m, float("nan") if (s, i) == (300, 12) else x) for s, i, m, x in found]

    run = read_metrics(write(tmp_path, edit=totals))
    seconds = lane_scores(run, SRL)["gauge_trial_seconds"]
    expected = 30.0 + np.arange(12.0, 24.0)
    expected[0] -= 10.0  # its total at 200
    np.testing.assert_array_equal(seconds.ravel(), expected)
    assert "gauge_trial_seconds" not in lane_scores(run, Group("ddpg", ""))


def test_a_failed_evaluation_is_listed_by_name(tmp_path):
    def once(rows):  # lane 13 explodes in one evaluation and is finite again later; lane 2 fails on the healthy robot
        rows = failing({2}, "healthy/")(rows)
        return [(s, i, m, float("inf") if (s, i) == (200, 13) and m.startswith("eval/") else x) for s, i, m, x in rows]

    summary = summarise(read_metrics(write(tmp_path, edit=once)), 50)
    json.dumps(summary, allow_nan=False)
    healthy, later = summary["nonfinite_lanes"]
    assert (healthy["lane"], healthy["step"], healthy["measured"]) == (2, 0, ["healthy"])
    assert (later["lane"], later["algo"], later["damage"], later["seed"]) == (13, "srl", "leg 1", 3)
    assert (later["step"], later["measured"]) == (200, ["eval"])
    assert summary["methods"]["srl"]["overall"]["reached_finish"]["mean"] == 1.0  # at 300


def test_improvement_covers_every_ordered_pair(tmp_path):
    summary = summarise(read_metrics(write(tmp_path)), resamples=200)
    pairs = {(x["x"], x["y"], x["score"]): x for x in summary["improvement"]}
    assert len(pairs) == len(summary["improvement"]) == 3 * 2 * 2
    assert pairs["srl", "ddpg", "area_success"]["probability"] == 1.0
    assert pairs["ddpg", "srl", "area_return"]["high"] == 0.0
    assert pairs["srl", "srl dropout=0.03", "area_success"]["probability"] == pytest.approx(0.5)
    assert "improvement_note" not in summary
    for (x, y, score), pair in pairs.items():
        turned = pairs[y, x, score]
        assert pair["low"] <= pair["probability"] <= pair["high"]
        assert (pair["low"], pair["high"]) == pytest.approx((1 - turned["high"], 1 - turned["low"]))


def test_each_pair_is_drawn_once_and_many_methods_only_against_the_first(tmp_path, monkeypatch):
    calls, real = [], statistics.probability_of_improvement
    counted = lambda *args, **options: (calls.append(1), real(*args, **options))[1]  # noqa: E731
    monkeypatch.setattr(statistics, "probability_of_improvement", counted)
    summarise(read_metrics(write(tmp_path)), resamples=10)
    assert len(calls) == 3 * 2
    calls.clear()
    many = {("srl", f"beta={n}"): n / 20 for n in range(13)}
    summary = summarise(read_metrics(write(tmp_path, methods=many)), resamples=10)
    assert len(calls) == 12 * 2
    assert all("srl beta=0" in (pair["x"], pair["y"]) for pair in summary["improvement"])
    assert "13 methods" in summary["improvement_note"] and "'srl beta=0'" in summary["improvement_note"]
