"""What a run measures, where people look for it: each target told of a run whose numbers are known."""

import csv
import struct

import numpy as np
import pytest

from srl_jax import statistics
from srl_jax.job import log_targets
from srl_jax.job.logs import Logs, parse
from srl_jax.job.progress import Progress
from tests.report import runs

SEEDS = np.array(runs.SEEDS)


def until(step):
    """An edit of a run: no more than it had measured at a step."""
    return lambda rows: [row for row in rows if row[0] <= step]


def told(logs, directory):
    logs.update(Progress(directory, "training", 0, 300, 0.0, 0.0, 0.0, {}))


def table(directory):
    """progress.csv as (step, name, metric) -> value, and its header."""
    with (directory / "progress.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    cells = {(int(row["step"]), row["name"], metric): row[metric] for row in rows for metric in reader.fieldnames[2:]}
    return {key: float(value) for key, value in cells.items() if value}, reader.fieldnames


def scalars(directory):
    """Every scalar of TensorBoard's files as (folder, tag, step, value), as they were written."""
    pytest.importorskip("tensorboardX", reason="the extra tensorboard is not installed")
    from tensorboardX.proto import event_pb2  # pyright: ignore[reportMissingImports]

    found = []
    for path in sorted(directory.rglob("events.*")):
        content = path.read_bytes()
        while content:
            (length,) = struct.unpack("<Q", content[:8])
            event = event_pb2.Event.FromString(content[12 : 12 + length])
            found += [(path.parent.name, one.tag, event.step, one.simple_value) for one in event.summary.value]
            content = content[16 + length :]
    return found


def test_a_method_is_told_by_the_interquartile_mean_of_its_lanes(tmp_path):
    runs.write(tmp_path)
    with Logs(("csv",)) as logs:
        told(logs, tmp_path)
    found, header = table(tmp_path)
    assert header[:2] == ["step", "name"] and "eval/success" in header and "train/chosen_teacher" in header
    assert {name for _, name, _ in found} == {"ddpg", "srl", "srl dropout=0.03"}
    lanes = 0.6 * 2 / 3 + 0.01 * np.repeat(SEEDS, len(runs.DAMAGES))
    assert found[200, "srl", "eval/success"] == pytest.approx(statistics.iqm(lanes))
    assert found[0, "ddpg", "healthy/return"] == 49.5 and (200, "ddpg", "healthy/return") not in found


def test_a_lane_that_explodes_counts_as_failed_where_it_was_judged_and_is_left_out_elsewhere(tmp_path):
    lost = set(range(3))
    judged, seen = runs.failing(lost, since=200), runs.failing(lost, "train/", since=200)
    runs.write(tmp_path, methods={("srl", ""): 0.6}, edit=lambda rows: seen(judged(rows)))
    with Logs(("csv",)) as logs:
        told(logs, tmp_path)
    found, _ = table(tmp_path)
    lanes = 0.6 + 0.01 * np.repeat(SEEDS, len(runs.DAMAGES))
    lanes[:3] = 0.0
    assert found[300, "srl", "eval/success"] == pytest.approx(statistics.iqm(lanes))
    assert found[300, "srl", "train/chosen_teacher"] == 0.5


def test_every_lane_is_told_by_itself(tmp_path):
    runs.write(tmp_path)
    with Logs(("csv",), "lane") as logs:
        told(logs, tmp_path)
    found, _ = table(tmp_path)
    assert len({name for _, name, _ in found}) == 3 * len(runs.DAMAGES) * len(SEEDS)
    assert found[300, "ddpg leg 1 seed 4", "eval/success"] == pytest.approx(0.24)


@pytest.mark.parametrize("by", ["method", "lane"])
def test_of_waves_lanes_are_told_at_once_and_methods_when_they_are_joined(by, tmp_path):
    first = runs.write(tmp_path / "wave-1", methods={("srl", ""): 0.6})
    with Logs(("csv",), by) as logs:
        told(logs, tmp_path)
        told(logs, first)
        assert (tmp_path / "progress.csv").exists() == (by == "lane")
        told(logs, runs.write(tmp_path / "behaviour", methods={("ddpg", ""): 0.6}))  # of a teacher: another run
        runs.write(tmp_path, methods={("srl", ""): 0.6})
    found, _ = table(tmp_path)
    assert (300, "srl" if by == "method" else "srl leg 0 seed 3", "eval/success") in found
    assert not any(name.startswith("ddpg") for _, name, _ in found)


def test_tensorboard_gets_what_is_new_and_a_resumed_run_begins_its_files_anew(tmp_path):
    for _ in range(2):
        with Logs(("tensorboard",)) as logs:
            for step in (100, 100, 300):
                told(logs, runs.write(tmp_path, edit=until(step)))
        found = scalars(tmp_path / "tensorboard")
        assert len(set(found)) == len(found)
        curve = [(step, value) for folder, tag, step, value in found if (folder, tag) == ("srl", "eval/success")]
        assert [step for step, _ in curve] == list(runs.STEPS)
        assert curve[-1][1] == pytest.approx(0.645)
    assert (tmp_path / "tensorboard" / "srl_dropout=0.03").is_dir()


def test_wandb_works_offline_and_goes_on_with_its_run(tmp_path, monkeypatch):
    pytest.importorskip("wandb", reason="the extra wandb is not installed")
    for name, value in {"WANDB_MODE": "offline", "WANDB_SILENT": "true", "WANDB_DIR": str(tmp_path)}.items():
        monkeypatch.setenv(name, value)
    logged, kept = [], log_targets.Sent.new
    monkeypatch.setattr(log_targets.Sent, "new", lambda *args: (logged.append(list(kept(*args))), logged[-1])[1])
    for step in (100, 300):
        with Logs(("wandb",)) as logs:
            told(logs, runs.write(tmp_path, edit=until(step)))
    files = sorted((tmp_path / "wandb").glob("offline-run-*/run-*.wandb"))
    assert len(files) == 2 and len({file.name for file in files}) == 1, "two processes, one run"
    assert b"srl/eval/success" in files[0].read_bytes()
    assert {step for step, *_ in logged[0]} == {0, 100} and {step for step, *_ in logged[1]} == {200, 300}


def test_a_run_that_failed_is_told_no_more_and_its_targets_are_closed(tmp_path, monkeypatch):
    closed = []
    monkeypatch.setattr(log_targets.Wide, "close", lambda wide: closed.append(wide))
    with pytest.raises(KeyboardInterrupt), Logs(("csv",)) as logs:
        told(logs, runs.write(tmp_path, edit=until(100)))
        runs.write(tmp_path)
        raise KeyboardInterrupt
    assert len(closed) == 1 and max(step for step, *_ in table(tmp_path)[0]) == 100


def test_without_a_word_nothing_is_written(tmp_path):
    before = sorted(runs.write(tmp_path).iterdir())
    with Logs(parse("")) as logs:
        told(logs, tmp_path)
    assert sorted(tmp_path.iterdir()) == before


def test_words_are_refused_that_name_nothing_or_what_is_not_installed(monkeypatch):
    assert parse(" csv, csv") == ("csv",)
    with pytest.raises(ValueError, match="log is 'mlflow': choose from tensorboard, wandb, csv, separated by commas"):
        parse("mlflow")
    monkeypatch.setattr("srl_jax.job.logs.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"wandb needs pip install 'srl-jax\[wandb\]'"):
        parse("wandb")
