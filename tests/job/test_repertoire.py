"""A search over a toy, and its files: it goes on to the same map however it ended."""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from srl_jax import arrays as arrays_files
from srl_jax.ite import archive as repertoire
from srl_jax.ite import elites
from srl_jax.ite import walk as evaluate
from srl_jax.ite.settings import RepertoireSettings
from srl_jax.job import files as output
from srl_jax.job import repertoire as search
from srl_jax.job import repertoire_files as files
from srl_jax.report import map as figure
from tests.job import toy_repertoire
from tests.job.toy_repertoire import make

TOY = Path(toy_repertoire.__file__)
GENERATIONS = 100
SETTINGS = RepertoireSettings(evaluations=16 * GENERATIONS, batch=16)
OPTIONS = ["--evaluations", str(SETTINGS.evaluations), "--batch", "16", "--devices", "2"]
FILES = {"config.json", "checkpoint.npz", "metrics.csv", "map.npz", "map.png", "summary.json"}


@pytest.fixture(scope="module")
def toy():
    """No physics in this process either."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluate, "make", make)
        yield


@pytest.fixture(scope="module")
def finished(toy, tmp_path_factory):
    """A search that was not interrupted."""
    directory = tmp_path_factory.mktemp("search") / "whole"
    return directory, search.run(SETTINGS, directory, 2)


def results(directory: Path):
    """What must not depend on interruptions."""
    with np.load(directory / "checkpoint.npz") as file:
        arrays = {name: file[name].tolist() for name in (*elites.Archive._fields, "history")}
    found = repertoire.load(directory / "map.npz")
    return arrays, (directory / "metrics.csv").read_text(), [np.asarray(x).tolist() for x in found[:3]]


def test_a_search_leaves_its_files(finished):
    directory, summary = finished
    assert {path.name for path in directory.iterdir() if not path.name.startswith(".")} == FILES
    rows = list(csv.DictReader((directory / "metrics.csv").read_text().splitlines()))
    assert [int(row["evaluations"]) for row in rows] == list(range(16, SETTINGS.evaluations + 1, 16))
    filled, best = ([float(row[name]) for row in rows] for name in ("filled", "best_fitness"))
    assert filled == sorted(filled) and best == sorted(best) and 0.0 < float(rows[0]["killed"]) < 1.0
    assert summary["filled"] == filled[-1] > 300
    assert summary["coverage"] == pytest.approx(summary["filled"] / 15_625)
    assert summary == json.loads((directory / "summary.json").read_text())
    assert summary["machine"]["devices"] == 2 and summary["machine"]["evaluations_per_second"] > 0


def test_the_map_has_every_elite_exactly(finished):
    directory, summary = finished
    found, archive = repertoire.load(directory / "map.npz"), files.read_checkpoint(directory / "checkpoint.npz").archive
    filled = np.isfinite(archive.fitness)
    np.testing.assert_array_equal(found.gaits, elites.gaits(archive.genes)[filled])
    np.testing.assert_array_equal(found.fitness, archive.fitness[filled])
    np.testing.assert_allclose(found.descriptors, archive.descriptors[filled], atol=1e-6)
    assert len(found.fitness) == summary["filled"] and found.about["best_fitness"] == summary["best_fitness"]
    assert found.about["clock_hz"] == 1.0 and "--batch 16 --seed 0 --damage healthy" in found.about["command"]


def test_a_killed_search_resumes_to_the_same_map(finished, tmp_path):
    directory = tmp_path / "killed"
    with subprocess.Popen([sys.executable, str(TOY), *OPTIONS, "--out", str(directory)]) as process:
        wait_for(lambda: (directory / "checkpoint.npz").exists(), process)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not (directory / "summary.json").exists()
    search.run(SETTINGS, directory, 2, resume=True)
    assert results(directory) == results(finished[0])


def test_a_stopped_search_goes_on_to_the_same_map(finished, tmp_path):
    asked = iter([False] * 3 + [True])
    assert search.run(SETTINGS, tmp_path / "run", 2, stopped=lambda: next(asked)) is None
    assert len(files.read_checkpoint(tmp_path / "run" / "checkpoint.npz").history) == 3
    search.run(SETTINGS, tmp_path / "run", 1, resume=True)
    assert results(tmp_path / "run") == results(finished[0])
    parts = output.read_parts(tmp_path / "run")
    assert [(part["devices"], part["from_step"]) for part in parts] == [(2, 0), (1, 48)]


def test_a_finished_search_may_be_given_more_evaluations(toy, finished, tmp_path):
    first = RepertoireSettings(evaluations=16 * 40, batch=16)
    search.run(first, tmp_path / "run", 2)
    search.run(SETTINGS, tmp_path / "run", 2, resume=True)
    assert results(tmp_path / "run") == results(finished[0])
    assert repertoire.load(tmp_path / "run" / "map.npz").about["evaluations"] == SETTINGS.evaluations


def test_seed_and_damage_matter_and_devices_do_not(toy, finished, tmp_path):
    search.run(SETTINGS, tmp_path / "one", 1)
    assert results(tmp_path / "one") == results(finished[0])
    search.run(RepertoireSettings(evaluations=16 * GENERATIONS, batch=16, seed=1), tmp_path / "two", 2)
    assert results(tmp_path / "two") != results(finished[0])


def wait_for(condition, process, seconds=120):
    begin = time.monotonic()
    while not condition():
        assert process.poll() is None, "ended early"
        assert time.monotonic() - begin < seconds
        time.sleep(0.02)


# What is refused


def test_another_search_in_the_directory(finished, toy):
    with output.in_use(finished[0]), pytest.raises(ValueError, match="in use by another job"):
        search.run(SETTINGS, finished[0], 2, resume=True)
    with pytest.raises(ValueError, match="is not empty"):
        search.run(SETTINGS, finished[0], 2)


def test_searches_of_one_second_get_directories_of_their_own(toy, tmp_path):
    small, told = RepertoireSettings(evaluations=16, batch=16), []
    for _ in range(2):
        search.run(small, tmp_path / "run", 2, exact=False, listener=lambda status: told.append(status.directory))
    assert list(dict.fromkeys(told)) == [tmp_path / "run", tmp_path / "run-2"]
    assert all((directory / "map.npz").exists() for directory in told)


def test_a_batch_that_does_not_divide(tmp_path):
    with pytest.raises(ValueError, match="batch is 33: give a multiple of the 2 devices"):
        search.run(RepertoireSettings(batch=33), tmp_path / "run", 2)
    assert not (tmp_path / "run").exists()


def test_files_that_are_no_repertoire_are_refused(finished, tmp_path):
    content = (finished[0] / "map.npz").read_bytes()
    for name, text in (("short", content[:500]), ("other", b"no archive")):
        (tmp_path / name).write_bytes(text)
        with pytest.raises(ValueError, match="cannot be read as a repertoire"):
            repertoire.load(tmp_path / name)
    with pytest.raises(ValueError, match="cannot be read as a repertoire"):
        repertoire.load(finished[0] / "checkpoint.npz")
    with pytest.raises(ValueError, match=r"python -m srl_jax\.repertoire"):
        repertoire.load(tmp_path / "missing.npz")
    with np.load(finished[0] / "map.npz") as file:
        arrays = dict(file)
    arrays["genes"][0, 0] = 21
    arrays_files.save(tmp_path / "bad.npz", **arrays)
    with pytest.raises(ValueError, match="out of range"):
        repertoire.load(tmp_path / "bad.npz")


# What is drawn


def test_the_picture_shows_every_cell_once():
    fitness = np.full(elites.CELLS, -np.inf, np.float32)
    fitness[[0, 1, 5**5, elites.CELLS - 1]] = [0.0, 1.0, 2.0, 3.0]
    image = figure.nested(fitness)
    assert image.shape == (125, 125) and np.isfinite(image).sum() == 4
    # Rows are the right legs, front leg coarsest; columns the left ones.
    assert (image[0, 0], image[0, 1], image[25, 0], image[124, 124]) == (0.0, 1.0, 2.0, 3.0)
