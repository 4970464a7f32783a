"""The tables of a run: whole rows only, cut back to a checkpoint, joined from parts."""

import pytest

from srl_jax.job import tables
from tests.job.conftest import DISK


def test_metrics_are_cut_back_to_where_a_checkpoint_left_them(tmp_path):
    metrics = tables.Metrics(tmp_path)
    metrics.write((step, 0, "eval/return", step / 3) for step in (0, 800))
    kept = metrics.size
    metrics.write([(1600, 0, "eval/return", 1.0)])
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("2400,0,eval/re")  # as a process leaves it that is killed
    tables.Metrics(tmp_path, keep=kept).write([(1600, 0, "eval/return", 2.0)])
    rows = (tmp_path / "metrics.csv").read_text().splitlines()
    assert rows == ["step,lane,metric,value", "0,0,eval/return,0", "800,0,eval/return,266.6667", "1600,0,eval/return,2"]


def test_metrics_that_lost_rows_are_refused(tmp_path):
    kept = tables.Metrics(tmp_path).size
    for text in ("step", None):
        (tmp_path / "metrics.csv").write_text(text) if text else (tmp_path / "metrics.csv").unlink()
        with pytest.raises(ValueError, match=r"metrics\.csv is shorter than when its checkpoint was saved"):
            tables.Metrics(tmp_path, keep=kept)


def test_metrics_on_a_full_disk_have_whole_rows_only(disk):
    metrics = tables.Metrics(disk)
    metrics.write([(0, 0, "eval/return", 1.5)])
    (disk / "ballast").write_bytes(b"x" * (DISK - 8192))
    before = (disk / "metrics.csv").read_bytes()
    with pytest.raises(OSError, match="No space left"):
        metrics.write((800, lane, "eval/return", 1 / 3) for lane in range(1000))
    assert (disk / "metrics.csv").read_bytes() == before == b"step,lane,metric,value\r\n0,0,eval/return,1.5\r\n"
    (disk / "ballast").unlink()
    metrics.write((800, lane, "eval/return", 1 / 3) for lane in range(1000))
    assert len((disk / "metrics.csv").read_text().splitlines()) == 1002


def test_metrics_of_parts_are_joined_in_order_under_one_header(tmp_path):
    for number in (1, 2):
        (tmp_path / str(number)).mkdir()
        tables.Metrics(tmp_path / str(number)).write([(0, number, "eval/return", number / 2)])
    for first, second in ((0, 2), (40, 42)):
        tables.join_metrics([(tmp_path / "1", 0), (tmp_path / "2", first)], tmp_path)
        rows = (tmp_path / "metrics.csv").read_text().splitlines()
        assert rows == ["step,lane,metric,value", "0,1,eval/return,0.5", f"0,{second},eval/return,1"]
