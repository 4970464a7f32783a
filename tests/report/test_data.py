"""The report of a synthetic run gives back what was put in."""

import csv
import json

import matplotlib.image
import numpy as np
import pytest

from srl_jax.report import data as report

DAMAGES, SEEDS, STEPS = ("leg 0", "leg 1", "leg 2"), (3, 4, 5, 6), (0, 100, 200, 300)
METHODS = {("ddpg", ""): 0.2, ("srl", ""): 0.6, ("srl", "dropout=0.03"): 0.6}


def table(path, header, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header.split(), *rows])


def write(path, *, methods=METHODS, seeds=SEEDS, damages=DAMAGES, task="p2p", edit=lambda rows: rows):
    """Lanes climb by `height` t / 3 plus .01 per seed: success; return is 100 and distance 2 times that."""
    keys = [(*method, seed, damage) for method in methods for seed in seeds for damage in damages]
    rows = []
    for lane, (algo, variant, seed, damage) in enumerate(keys):
        for t, step in enumerate(STEPS):
            success = METHODS[algo, variant] * t / 3 + 0.01 * seed
            values = {"success": success, "return": 100 * success, "distance": 2 * success, "fell": 0.25}
            rows += [(step, lane, f"eval/{name}", value) for name, value in values.items()]
            rows.append((step, lane, "train/chosen_teacher", 0.5))
        frozen = {"success": 0.1 + 0.1 * damages.index(damage), "return": 12.0, "distance": 0.4}
        rows += [(0, lane, f"teacher/{name}", value) for name, value in frozen.items()]
        rows += [(0, lane, f"healthy/{name}", x) for name, x in zip(frozen, (0.9, 49.5, 1.6), strict=True)]
    lanes = [(i, a, s, task, d, v) for i, (a, v, s, d) in enumerate(keys)]
    table(path / "lanes.csv", "lane algo seed task damage variant", lanes)
    table(path / "metrics.csv", "step lane metric value", edit(rows))
    (path / "config.json").write_text(json.dumps({"task": task}))
    return path


def test_series_keep_every_lane_apart(tmp_path):
    run = report.read_metrics(write(tmp_path))
    steps, values, seeds, conditions = run.series("eval/return", "srl", "dropout=0.03")
    assert (run.task, run.config["task"], seeds, conditions) == ("p2p", "p2p", list(SEEDS), list(DAMAGES))
    np.testing.assert_array_equal(steps, STEPS)
    expected = 100 * (0.6 * np.arange(4)[:, None, None] / 3 + 0.01 * np.array(SEEDS)[:, None])
    np.testing.assert_allclose(values, np.broadcast_to(expected, (4, 4, 3)))
    assert [group.label for group in run.groups] == ["ddpg", "srl", "srl dropout=0.03"]
    assert run.finish == pytest.approx(0.9 * 49.5)


def test_summary_holds_what_was_put_in(tmp_path):
    summary = report.summarise(report.read_metrics(write(tmp_path)))
    json.dumps(summary, allow_nan=False)
    assert summary["healthy"] == pytest.approx({"return": 49.5, "success": 0.9, "distance": 1.6})
    assert (summary["task"], summary["steps"], summary["nonfinite_lanes"]) == ("p2p", 300, [])
    srl, ddpg = summary["methods"]["srl"], summary["methods"]["ddpg"]
    end = 0.5 + 0.045  # mean of .4 and .6, and the seeds' mean offset
    assert srl["overall"]["success"]["iqm"] == pytest.approx(end)
    assert srl["overall"]["return"]["iqm"] == pytest.approx(100 * end)
    assert srl["overall"]["retained"]["iqm"] == pytest.approx(2 * end / 1.6)
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


def test_improvement_covers_every_ordered_pair(tmp_path):
    summary = report.summarise(report.read_metrics(write(tmp_path)), resamples=200)
    pairs = {(x["x"], x["y"], x["score"]): x for x in summary["improvement"]}
    assert len(pairs) == len(summary["improvement"]) == 3 * 2 * 2
    assert pairs["srl", "ddpg", "area_success"]["probability"] == 1.0
    assert pairs["ddpg", "srl", "area_return"]["high"] == 0.0
    assert pairs["srl", "srl dropout=0.03", "area_success"]["probability"] == pytest.approx(0.5)


def test_diverged_lane_counts_as_failed_and_is_listed(tmp_path):
    def diverge(rows):
        return [(s, i, m, float("nan") if i == 13 and s >= 200 else x) for s, i, m, x in rows]

    run = report.read_metrics(write(tmp_path, edit=diverge))
    summary = report.summarise(run, resamples=200)
    json.dumps(summary, allow_nan=False)
    (lane,) = summary["nonfinite_lanes"]
    assert (lane["lane"], lane["algo"], lane["damage"], lane["step"]) == (13, "srl", "leg 1", 200)
    assert np.isnan(run.series("eval/success", "srl").values[2:, 0, 1]).all()
    scores = run.scores("eval/success", report.Group("srl", ""))
    assert scores is not None
    np.testing.assert_allclose(scores.values[2:, 0, 1], 0.03)  # the lowest success of any lane
    assert summary["methods"]["srl"]["overall"]["reached_finish"]["mean"] == pytest.approx(11 / 12)


def test_run_that_was_cut_off_or_resumed_is_read(tmp_path):
    def cut(rows):
        again = [(s, i, m, 0.77) for s, i, m, _ in rows if (s, i, m) == (100, 0, "eval/success")]
        return [row for row in rows if row[:2] != (300, 35)] + again

    write(tmp_path, edit=cut)
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("300,35,eval/suc")
    run = report.read_metrics(tmp_path)
    assert run.series("eval/success", "srl", "dropout=0.03").steps.tolist() == [0, 100, 200]
    assert run.series("eval/success", "ddpg").values[1, 0, 0] == 0.77


def test_errors_name_what_is_wrong(tmp_path):
    with pytest.raises(ValueError, match=r"no lanes\.csv"):
        report.read_metrics(tmp_path)
    run = report.read_metrics(write(tmp_path, edit=lambda rows: [r for r in rows if r[:2] != (100, 2)]))
    with pytest.raises(ValueError, match="lane 2 at step 100"):
        run.series("eval/return", "ddpg")
    with pytest.raises(ValueError, match="any lane"):
        run.series("eval/speed", "srl")
    with pytest.raises(ValueError, match="task is 'x'; this run holds p2p"):
        report.read_metrics(tmp_path, task="x")
    table(tmp_path / "metrics.csv", "step lane value", [])
    with pytest.raises(ValueError, match=r"metrics\.csv lacks column metric"):
        report.read_metrics(tmp_path)
    run.lanes.pop()
    with pytest.raises(ValueError, match="do not fill its seeds x damages"):
        run.series("eval/return", "srl", "dropout=0.03")


def test_run_without_behaviour_policy_leaves_its_numbers_out(tmp_path):
    write(tmp_path, edit=lambda rows: [r for r in rows if not r[2].startswith(("teacher/", "healthy/"))])
    summary = report.summarise(report.read_metrics(tmp_path), resamples=50)
    assert summary["finish"] is None
    assert "retained" not in summary["methods"]["srl"]["overall"]
    assert report.format_table(summary)[2][4:] == ["-", "-"]


def test_table_reads_like_a_paper(tmp_path):
    header, ddpg, srl, _ = report.format_table(report.summarise(report.read_metrics(write(tmp_path))))
    assert header == ["method", "success", "return", "area", "retained", "steps to finish"]
    assert ddpg[0] == "ddpg" and ddpg[-1] == "never"
    assert srl[1].startswith(".55 [.5") or srl[1].startswith(".54 [.5")
    assert srl[2].startswith("54.5 [5") and srl[3].startswith((".34 [.3", ".35 [.3")) and srl[5].startswith("250 [")


@pytest.mark.parametrize("task", ["p2p", "x"])
@pytest.mark.parametrize(("seeds", "damages"), [(SEEDS, DAMAGES), (SEEDS[:1], DAMAGES[:1])])
def test_curves_are_drawn(tmp_path, task, seeds, damages):
    methods = METHODS if len(seeds) > 1 else [("srl", "")]
    run = report.read_metrics(write(tmp_path, methods=methods, task=task, seeds=seeds, damages=damages))
    report.save_curves(run, tmp_path / "curves.png")
    image = matplotlib.image.imread(tmp_path / "curves.png")
    assert image.shape[0] > 600 and image.shape[1] > 1500
    blue = np.abs(image[..., :3] - np.array([0x00, 0x72, 0xB2]) / 255).max(axis=-1) < 0.02
    assert blue.sum() > 500
