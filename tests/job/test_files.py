"""The files of a job: directories that no two jobs share, locks, a full disk, and what each process adds."""

import dataclasses
import errno
import fcntl
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from srl_jax import machine
from srl_jax.cli.ending import leave
from srl_jax.config import Config, preset
from srl_jax.job import files
from tests.job.conftest import DISK

# Directories


def test_jobs_of_one_second_get_directories_of_their_own(tmp_path):
    wanted, claimed = tmp_path / "runs" / "p2p-20261124-210000", []
    begin = threading.Barrier(8)

    def job():
        begin.wait()
        claimed.append(files.claim(wanted, exact=False))

    jobs = [threading.Thread(target=job) for _ in range(8)]
    for thread in jobs:
        thread.start()
    for thread in jobs:
        thread.join()
    names = {wanted.name} | {f"{wanted.name}-{number}" for number in range(2, 9)}
    assert {path.name for path in claimed} == names == {path.name for path in wanted.parent.iterdir()}


def test_a_directory_that_was_asked_for_is_that_one_or_none(tmp_path):
    assert files.claim(tmp_path / "new" / "out", exact=True) == tmp_path / "new" / "out"
    assert files.claim(tmp_path / "new" / "out", exact=True).is_dir()  # empty still
    with pytest.raises(ValueError, match=r"out is .*new: it is not empty"):
        files.claim(tmp_path / "new", exact=True)


def test_a_file_in_the_way_is_no_reason_to_search_for_names(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(FileExistsError):
        files.claim(tmp_path / "runs" / "p2p", exact=False)


# Locks


def test_a_directory_that_another_process_holds_is_refused(tmp_path, capsys):
    code = "import sys, pathlib; from srl_jax.job import files\n"
    code += "with files.in_use(pathlib.Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout and other.stdout.readline() == "held\n"
        with pytest.raises(SystemExit) as caught:
            leave(enter, tmp_path)
        assert caught.value.code == 2
        said = capsys.readouterr().err
        assert said == f"srl_jax: {tmp_path} is in use by another job; wait for it or choose another directory.\n"
        other.communicate("")
    enter(tmp_path)  # it has left


def enter(directory: Path) -> None:
    with files.in_use(directory):
        pass


def refusing(number):
    def flock(file, how):
        raise OSError(number, os.strerror(number))

    return flock


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL])
def test_a_file_system_without_locks_is_no_other_job(number, tmp_path, monkeypatch):
    monkeypatch.setattr(fcntl, "flock", refusing(number))
    enter(tmp_path)


@pytest.mark.parametrize("number", [errno.EAGAIN, errno.EACCES])
def test_a_lock_that_is_held_is_another_job(number, tmp_path, monkeypatch):
    monkeypatch.setattr(fcntl, "flock", refusing(number))
    with pytest.raises(ValueError, match="in use"):
        enter(tmp_path)


def test_another_fault_of_the_lock_is_told_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(fcntl, "flock", refusing(errno.EIO))
    with pytest.raises(OSError, match="Input/output"):
        enter(tmp_path)


def test_a_system_without_locks(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fcntl", None)
    enter(tmp_path)


# A full disk


def test_a_full_disk_leaves_the_old_file_and_is_one_sentence(disk, capsys):
    files.write_json(disk / "summary.json", {"old": True})
    with pytest.raises(SystemExit) as caught:
        leave(files.write_json, disk / "summary.json", {"new": "x" * DISK})
    assert caught.value.code == 2
    assert capsys.readouterr().err == "srl_jax: No space left on device: while writing results.\n"
    assert [path.name for path in disk.iterdir()] == ["summary.json"]
    assert json.loads((disk / "summary.json").read_text()) == {"old": True}


# What was asked, and by whom


def test_every_part_of_a_run_is_kept(tmp_path, monkeypatch):
    config = preset("smoke")
    monkeypatch.setattr(machine, "versions", lambda: {"jax": "1"})
    files.write_config(tmp_path, config, 2)
    monkeypatch.setattr(machine, "versions", lambda: {"jax": "2"})
    files.write_config(tmp_path, config, 4, from_step=800)
    first, second = files.read_parts(tmp_path)
    assert (first["versions"], first["devices"], first["from_step"]) == ({"jax": "1"}, 2, 0)
    assert (second["versions"], second["devices"], second["from_step"]) == ({"jax": "2"}, 4, 800)
    assert first["began"] <= second["began"] and first["python"] and first["machine"]
    assert files.read_config(tmp_path) == (config, 4)


@pytest.mark.parametrize("name", ["default", "paper", "robot", "smoke"])
def test_settings_survive_the_file(name, tmp_path):
    files.write_config(tmp_path, preset(name), 3)
    assert files.read_config(tmp_path) == (preset(name), 3)


BROKEN = {
    "no JSON": "{",
    "no configuration": "{}",
    "a list": "[]",
    "no parts": '{"config": {}}',
    "binary": "\x00\x01",
}


def test_a_run_that_is_older_than_an_algorithm_is_read(tmp_path):
    config = dataclasses.replace(preset("smoke"), algos="ddpg")
    files.write_config(tmp_path, config, 1)
    stored = json.loads((tmp_path / "config.json").read_text())
    del stored["config"]["jsrl"]
    (tmp_path / "config.json").write_text(json.dumps(stored))
    assert files.read_config(tmp_path) == (dataclasses.replace(config, jsrl=Config().jsrl), 1)
    del stored["config"]["env"]
    (tmp_path / "config.json").write_text(json.dumps(stored))
    with pytest.raises(ValueError, match="of this version: 'env'"):
        files.read_config(tmp_path)


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_no_configuration_is_one_sentence(case, tmp_path):
    (tmp_path / "config.json").write_text(BROKEN[case])
    for read in (files.read_config, files.read_parts) if case != "no parts" else (files.read_parts,):
        with pytest.raises(ValueError, match="cannot be read as a configuration of this version"):
            read(tmp_path)


def test_settings_of_another_version_are_one_sentence(tmp_path):
    files.write_config(tmp_path, preset("smoke"), 1)
    stored = json.loads((tmp_path / "config.json").read_text())
    stored["config"]["env"]["gravity"] = 9.81
    (tmp_path / "config.json").write_text(json.dumps(stored))
    with pytest.raises(ValueError, match=r"config\.json cannot be read .*gravity"):
        files.read_config(tmp_path)


def test_differences_name_the_section(tmp_path):
    one = preset("smoke")
    other = dataclasses.replace(one, steps=3200, srl=dataclasses.replace(one.srl, dropout=(0.5,)))
    assert files.differences(vars(one), vars(other)) == ["steps", "srl.dropout"]


def test_reading_a_configuration_imports_no_jax(tmp_path):
    files.write_config(tmp_path, preset("smoke"), 2)
    code = "import sys, pathlib; from srl_jax.job import files\n"
    code += "files.read_config(pathlib.Path(sys.argv[1])); sys.exit('jax' in sys.modules)"
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
