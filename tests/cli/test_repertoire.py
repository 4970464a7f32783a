"""The verb `repertoire` over a toy: what it accepts, what it refuses in one sentence, and how it ends."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from srl_jax.cli import repertoire as cli
from srl_jax.ite import walk as evaluate
from srl_jax.ite.settings import RepertoireSettings
from srl_jax.job import files as output
from srl_jax.job import repertoire as search
from srl_jax.job import repertoire_files as files
from tests.job.toy_repertoire import make

SETTINGS = RepertoireSettings(evaluations=16 * 5, batch=16)
OPTIONS = ["--evaluations", str(SETTINGS.evaluations), "--batch", "16", "--devices", "2"]


@pytest.fixture(scope="module", autouse=True)
def toy():
    """Milliseconds instead of physics."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluate, "make", make)
        patch.setattr(cli, "use_devices", lambda wanted, lanes, **_: 2)
        yield


@pytest.fixture(scope="module")
def finished(toy, tmp_path_factory):
    """A finished search."""
    directory = tmp_path_factory.mktemp("search") / "whole"
    return directory, search.run(SETTINGS, directory, 2)


def command(capsys, *arguments):
    """Exit code, output and complaint of the verb."""
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    return caught.value.code, *capsys.readouterr()


def test_a_search_says_what_it_found_and_where(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, printed, _ = command(capsys, *OPTIONS)
    (directory,) = (tmp_path / "runs").glob("repertoire-*")
    assert code == 0 and f"Results go to runs/{directory.name}" in printed
    assert "80 gaits in" in printed and "Files: " in printed and (directory / "map.npz").exists()


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
    monkeypatch.setattr(cli, "StopSignals", Signalled)
    code, printed, _ = command(capsys, *OPTIONS, "--out", str(directory))
    assert code == 128 + signal.SIGTERM
    assert f"srl-jax repertoire --resume {directory}" in printed
    monkeypatch.undo()
    assert command(capsys, "--resume", str(directory))[0] == 0
    histories = [files.read_checkpoint(path / "checkpoint.npz").history for path in (directory, finished[0])]
    np.testing.assert_array_equal(*histories)


def test_a_finished_search_may_be_given_more_evaluations(finished):
    arguments, more = cli.parse(["--resume", str(finished[0]), "--evaluations", "160"])
    assert more == RepertoireSettings(evaluations=160, batch=16) and arguments.resume


@pytest.mark.parametrize(("batch", "devices"), [("1024", 2), ("33", 1)])
def test_auto_takes_as_many_devices_as_divide_the_batch(batch, devices, capsys, monkeypatch):
    def refuse(settings, directory, devices, **_):
        raise ValueError(f"asked for {devices}")

    monkeypatch.setattr(search, "run", refuse)
    assert sentence(capsys, "--batch", batch) == f"srl_jax: asked for {devices}\n"


# What is refused


def sentence(capsys, *arguments):
    """The one line on stderr of a command that is refused."""
    code, _, said = command(capsys, *arguments)
    assert code == 2 and said.count("\n") == 1, said
    return said


REFUSED = [
    (["--evaluations", "0"], "evaluations is 0"),
    (["--batch", "-4"], "batch is -4"),
    (["--batch", "33", "--devices", "2"], "batch is 33"),
    (["--seed", "-1"], "seed is -1"),
    (["--damage", "leg_zz"], "leg_zz"),
    (["--clock-hz", "0"], "clock_hz is 0.0"),
    (["--clock-hz", "nan"], "clock_hz is nan"),
]


@pytest.mark.parametrize("arguments, message", REFUSED)
def test_refused_before_anything_is_written(arguments, message, capsys, tmp_path):
    out = tmp_path / "out"
    assert message in sentence(capsys, *arguments, "--out", str(out))
    assert not out.exists()


def test_directories_that_cannot_be_used_are_refused(finished, capsys, tmp_path):
    whole = str(finished[0])
    assert "is not empty" in sentence(capsys, "--out", whole)
    assert "no config.json" in sentence(capsys, "--resume", str(tmp_path))
    line = sentence(capsys, "--resume", whole, "--seed", "3", "--damage", "leg_rm")
    assert "seed" in line and "damage" in line
    assert "evaluations is 16" in sentence(capsys, "--resume", whole, "--evaluations", "16")
    with output.in_use(finished[0]):
        assert "in use" in sentence(capsys, "--resume", whole)


def test_a_truncated_checkpoint_is_one_sentence(finished, capsys, tmp_path):
    for name in ("config.json", "checkpoint.npz"):
        content = (finished[0] / name).read_bytes()
        (tmp_path / name).write_bytes(content if name == "config.json" else content[: len(content) // 2])
    assert "cannot be read" in sentence(capsys, "--resume", str(tmp_path))


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
