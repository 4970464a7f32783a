"""A run's directory is read as it was written, and a failed evaluation is worth what the lane alone decides."""

import json

import numpy as np
import pytest

from srl_jax.report import files
from srl_jax.report.data import Group, read_metrics
from tests.report.runs import CONFIG, DAMAGES, SEEDS, STEPS, failing, scaled, table, write


def test_series_keep_every_lane_apart(tmp_path):
    run = read_metrics(write(tmp_path))
    steps, values, seeds, conditions = run.series("eval/return", "srl", "dropout=0.03")
    assert (run.task, run.config["task"], seeds, conditions) == ("p2p", "p2p", list(SEEDS), list(DAMAGES))
    np.testing.assert_array_equal(steps, STEPS)
    expected = 100 * (0.6 * np.arange(4)[:, None, None] / 3 + 0.01 * np.array(SEEDS)[:, None])
    np.testing.assert_allclose(values, np.broadcast_to(expected, (4, 4, 3)))
    assert [group.label for group in run.groups] == ["ddpg", "srl", "srl dropout=0.03"]


def test_lanes_in_any_order_and_number_keep_their_values(tmp_path):
    plain = read_metrics(write(tmp_path / "plain")).series("eval/distance", "srl")
    write(tmp_path / "mixed", first=700, edit=lambda rows: rows[::-1])
    header, *lanes = (tmp_path / "mixed" / "lanes.csv").read_text().splitlines(keepends=True)
    (tmp_path / "mixed" / "lanes.csv").write_text("".join([header, *lanes[::-1]]))
    mixed = read_metrics(tmp_path / "mixed").series("eval/distance", "srl")
    assert (mixed.seeds, mixed.conditions) == (list(SEEDS), list(DAMAGES[::-1]))
    np.testing.assert_array_equal(mixed.values[:, :, ::-1], plain.values)


def test_a_long_file_is_read_in_parts(tmp_path, monkeypatch):
    whole = read_metrics(write(tmp_path))
    monkeypatch.setattr(files, "ROWS_AT_ONCE", 7)
    parts = read_metrics(tmp_path)
    assert list(parts.metrics) == list(whole.metrics)
    for name, rows in whole.metrics.items():
        for one, other in zip(rows, parts.metrics[name], strict=True):
            np.testing.assert_array_equal(one, other)


def test_every_lane_has_its_own_threshold(tmp_path):
    run = read_metrics(write(tmp_path, edit=scaled({0: {"healthy/return": 2.0}, 1: {"healthy/return": -1.0}})))
    assert run.thresholds[0] == pytest.approx(0.9 * 99)
    assert np.isnan(run.thresholds[1])
    np.testing.assert_allclose(run.thresholds[2:], 0.9 * 49.5)
    assert run.finish == pytest.approx(np.nanmean(run.thresholds))


def test_episodes_of_an_evaluation(tmp_path):
    assert read_metrics(write(tmp_path)).episodes == 10
    old = {key: value for key, value in CONFIG.items() if key != "evaluation"}
    assert read_metrics(write(tmp_path, config=old)).episodes == 4


def test_a_failed_evaluation_is_worth_what_the_lane_decides(tmp_path):
    def below(rows):
        rows = failing({13}, since=200)(rows)
        return [(s, i, m, -7.0 if (s, i, m) == (100, 13, "eval/return") else x) for s, i, m, x in rows]

    run = read_metrics(write(tmp_path, edit=below))
    assert np.isnan(run.series("eval/success", "srl").values[2:, 0, 1]).all()
    expected = {"success": 0.0, "fell": 1.0, "distance": 0.0, "return": -7.0}
    for name, value in expected.items():
        scores = run.scores(f"eval/{name}", Group("srl", ""))
        assert scores is not None
        np.testing.assert_array_equal(scores.values[2:, 0, 1], value)
        assert np.isfinite(scores.values).all()
    positive = read_metrics(write(tmp_path, edit=failing({13}, since=200))).scores("eval/return", Group("srl", ""))
    assert positive is not None
    np.testing.assert_array_equal(positive.values[2:, 0, 1], 0.0)
    never = read_metrics(write(tmp_path, edit=failing({13}))).scores("eval/return", Group("srl", ""))
    assert never is not None
    np.testing.assert_array_equal(never.values[:, 0, 1], 0.0)


def test_last_values_by_lane(tmp_path):
    last = read_metrics(write(tmp_path, first=40, edit=failing({41}, since=300))).last("eval/return")
    assert sorted(last) == list(range(40, 76))
    assert last[40] == pytest.approx(23.0) and np.isnan(last[41])


def test_run_that_was_cut_off_or_resumed_is_read(tmp_path):
    def cut(rows):
        again = [(s, i, m, 0.77) for s, i, m, _ in rows if (s, i, m) == (100, 0, "eval/success")]
        return [row for row in rows if row[:2] != (300, 35)] + again

    write(tmp_path, edit=cut)
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("300,35,eval/success,0.6")
    run = read_metrics(tmp_path)
    assert run.series("eval/success", "srl", "dropout=0.03").steps.tolist() == [0, 100, 200]
    assert run.series("eval/success", "ddpg").steps.tolist() == [0, 100, 200, 300]
    assert run.series("eval/success", "ddpg").values[1, 0, 0] == 0.77


def test_errors_name_what_is_wrong(tmp_path):
    with pytest.raises(ValueError, match=r"no lanes\.csv"):
        read_metrics(tmp_path)
    run = read_metrics(write(tmp_path, edit=lambda rows: [r for r in rows if r[:2] not in ((100, 2), (200, 4))]))
    with pytest.raises(ValueError, match="for lane 2 at step 100 and 1 more"):
        run.series("eval/return", "ddpg")
    for metric, algo in (("eval/speed", "srl"), ("eval/return", "sarsa")):
        with pytest.raises(ValueError, match=f"'{algo}' has no rows of '{metric}' for any lane"):
            run.series(metric, algo)
    with pytest.raises(ValueError, match="task is 'x'; this run holds p2p"):
        read_metrics(tmp_path, task="x")


def test_files_that_are_not_a_runs_are_named(tmp_path):
    write(tmp_path)
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("300,35\n")
    with pytest.raises(ValueError, match=r"metrics\.csv, line \d+, has fewer columns"):
        read_metrics(tmp_path)
    table(tmp_path / "metrics.csv", "step lane value", [])
    with pytest.raises(ValueError, match=r"metrics\.csv lacks column metric"):
        read_metrics(tmp_path)
    text = (tmp_path / "lanes.csv").read_text().splitlines(keepends=True)
    (tmp_path / "lanes.csv").write_text("".join(text[:-1]))
    table(tmp_path / "metrics.csv", "step lane metric value", [])
    with pytest.raises(ValueError, match="do not fill its seeds x damages"):
        read_metrics(tmp_path).series("eval/return", "srl", "dropout=0.03")


def test_a_run_of_two_tasks_is_read_one_at_a_time(tmp_path):
    write(tmp_path)
    lanes = (tmp_path / "lanes.csv").read_text()
    (tmp_path / "lanes.csv").write_text(lanes.replace("ddpg,3,p2p", "ddpg,3,x"))
    with pytest.raises(ValueError, match="task is None; this run holds x, p2p: name one"):
        read_metrics(tmp_path)
    run = read_metrics(tmp_path, task="x")
    assert [lane["lane"] for lane in run.lanes] == [0, 1, 2]
    assert run.series("eval/success", "ddpg").values.shape == (4, 1, 3)
    json.dumps(run.last("eval/success"))
