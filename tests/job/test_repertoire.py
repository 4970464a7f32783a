"""A search over a toy, and its files: it goes on to the same map however it ended; bad input is one sentence."""

import csv
import importlib.util
import io
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from srl_jax.cli import repertoire as cli
from srl_jax.cli.repertoire_progress import SearchDisplay
from srl_jax.ite import archive as repertoire
from srl_jax.ite import elites
from srl_jax.ite import walk as evaluate
from srl_jax.ite.settings import RepertoireSettings
from srl_jax.job import files as output
from srl_jax.job import repertoire as search
from srl_jax.job import repertoire_files as files
from srl_jax.report import map as figure

TOY = Path(__file__).with_name("toy_repertoire.py")
GENERATIONS = 100
SETTINGS = RepertoireSettings(evaluations=16 * GENERATIONS, batch=16)
OPTIONS = ["--evaluations", str(SETTINGS.evaluations), "--batch", "16", "--devices", "2"]
FILES = {"config.json", "checkpoint.npz", "metrics.csv", "map.npz", "map.png", "summary.json"}


@pytest.fixture(scope="module")
def toy():
    """No physics in this process either."""
    spec = importlib.util.spec_from_file_location("toy_repertoire", TOY)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluate, "make", module.make)
        yield module


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


class Signalled:
    """A signal that comes during the third generation."""

    number = signal.SIGTERM

    def __init__(self):
        self.asked = 0

    def requested(self):
        self.asked += 1
        return self.asked > 3


def test_a_terminated_search_says_how_to_go_on(finished, capsys, monkeypatch, tmp_path):
    directory = tmp_path / "terminated"
    monkeypatch.setattr(cli.run, "use_devices", lambda wanted: 2)
    monkeypatch.setattr(cli.run, "StopSignals", Signalled)
    with pytest.raises(SystemExit) as caught:
        cli.main([*OPTIONS, "--out", str(directory)])
    assert caught.value.code == 128 + signal.SIGTERM
    assert f"--resume {directory}" in capsys.readouterr().out
    assert len(files.read_checkpoint(directory / "checkpoint.npz").history) == 3
    search.run(SETTINGS, directory, 2, resume=True)
    assert results(directory) == results(finished[0])


def test_a_finished_search_may_be_given_more_evaluations(toy, finished, tmp_path):
    first = RepertoireSettings(evaluations=16 * 40, batch=16)
    search.run(first, tmp_path / "run", 2)
    arguments, more = cli.parse(["--resume", str(tmp_path / "run"), "--evaluations", str(SETTINGS.evaluations)])
    assert more == SETTINGS and arguments.resume
    search.run(more, tmp_path / "run", 2, resume=True)
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


def sentence(capsys, monkeypatch, *arguments):
    """The one line on stderr of a command that is refused."""
    monkeypatch.setattr(cli.run, "use_devices", lambda wanted: 2)
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    assert caught.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


REFUSED = [
    (["--evaluations", "0"], "evaluations is 0"),
    (["--batch", "-4"], "batch is -4"),
    (["--batch", "33"], "batch is 33"),
    (["--seed", "-1"], "seed is -1"),
    (["--damage", "leg_zz"], "leg_zz"),
    (["--clock-hz", "0"], "clock_hz is 0.0"),
    (["--clock-hz", "nan"], "clock_hz is nan"),
]


@pytest.mark.parametrize("arguments, message", REFUSED)
def test_refused_before_anything_is_written(arguments, message, capsys, monkeypatch, tmp_path):
    out = tmp_path / "out"
    assert message in sentence(capsys, monkeypatch, *arguments, "--out", str(out))
    assert not out.exists()


def test_directories_that_cannot_be_used_are_refused(finished, capsys, monkeypatch, tmp_path):
    whole = str(finished[0])
    assert "is not empty" in sentence(capsys, monkeypatch, "--out", whole)
    assert "no config.json" in sentence(capsys, monkeypatch, "--resume", str(tmp_path))
    line = sentence(capsys, monkeypatch, "--resume", whole, "--seed", "3", "--damage", "leg_rm")
    assert "seed" in line and "damage" in line
    assert "evaluations is 16" in sentence(capsys, monkeypatch, "--resume", whole, "--evaluations", "16")
    with output.in_use(finished[0]):
        assert "in use" in sentence(capsys, monkeypatch, "--resume", whole)


def test_a_truncated_checkpoint_is_one_sentence(finished, capsys, monkeypatch, tmp_path):
    for name in ("config.json", "checkpoint.npz"):
        content = (finished[0] / name).read_bytes()
        (tmp_path / name).write_bytes(content if name == "config.json" else content[: len(content) // 2])
    assert "cannot be read" in sentence(capsys, monkeypatch, "--resume", str(tmp_path))


def test_a_full_disk_is_one_sentence(toy, capsys, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device", str(tmp_path / "out" / "checkpoint.npz"))

    monkeypatch.setattr(files, "write_checkpoint", full)
    assert "No space left" in sentence(capsys, monkeypatch, *OPTIONS, "--out", str(tmp_path / "out"))


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
    repertoire.save_arrays(tmp_path / "bad.npz", **arrays)
    with pytest.raises(ValueError, match="out of range"):
        repertoire.load(tmp_path / "bad.npz")


def test_help_answers_without_jax():
    code = """
import sys
from srl_jax.cli import repertoire
try:
    repertoire.main(["--help"])
except SystemExit:
    assert "jax" not in sys.modules
"""
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "--evaluations" in printed and "--damage" in printed


# What is shown


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_shows_cells_and_speed(terminal):
    console = Console(file=io.StringIO(), force_terminal=terminal, color_system=None, width=160)
    with SearchDisplay(Path("runs/here"), console) as display:
        display.show(search.Status("compiling", 0, 4096, 0, 0.0, 0.0, 0.0))
        for second in range(20):
            display.show(search.Status("searching", 1024, 4096, 810, 1.5, 50.0, float(second)))
        display.show(search.Status("searching", 4096, 4096, 2000, 2.0, 50.0, 21.0))
    printed = console.file.getvalue()
    for part in ("runs/here", "50 gaits/s", "2,000 cells", "best 0.400 m/s"):
        assert part in printed
    assert terminal or printed.count("searching") == 2


def test_the_picture_shows_every_cell_once():
    fitness = np.full(elites.CELLS, -np.inf, np.float32)
    fitness[[0, 1, 5**5, elites.CELLS - 1]] = [0.0, 1.0, 2.0, 3.0]
    image = figure.nested(fitness)
    assert image.shape == (125, 125) and np.isfinite(image).sum() == 4
    # Rows are the right legs, front leg coarsest; columns the left ones.
    assert (image[0, 0], image[0, 1], image[25, 0], image[124, 124]) == (0.0, 1.0, 2.0, 3.0)
