"""How a pack stands, told from its files alone."""

import json
import os
import socket
import time

import pytest

from srl_jax.config import Config
from srl_jax.sweep import attempts
from srl_jax.sweep.manifest import Pack


def pack_of(folder):
    return Pack(0, folder, Config(), (), folder)


def write(folder, *ends, lease="", done=False):
    """The pack's files: an attempt for each end, None for one that has none yet."""
    for end in ends:
        attempts.begin(folder)
        if end is not None:
            attempts.end(folder, *end)
    if lease:
        about = {"token": "x", "host": lease, "pid": 1, "began": ""}
        (folder / attempts.LEASE).write_text(json.dumps(about))
    if done:
        (folder / "summary.json").touch()
    return attempts.fate(pack_of(folder))


FATES = {
    "never begun": ([], {}, "waiting"),
    "now": ([None], {"lease": "elsewhere"}, "running"),
    "its machine was lost": ([None], {}, "cut off"),
    "stopped": ([(143, "stopped and saved")], {}, "waiting"),
    "bad input": ([(2, "seeds is x")], {}, "failed"),
    "tried again": ([(1, "disk full"), None], {"lease": "elsewhere"}, "running"),
    "done": ([(1, "disk full"), (0, "")], {"done": True}, "done"),
}


@pytest.mark.parametrize("name", FATES)
def test_fates(name, tmp_path):
    ends, facts, state = FATES[name]
    found = write(tmp_path, *ends, **facts)
    assert (found.state, found.attempts) == (state, len(ends))
    assert found.error == (ends[-1][1] if state in ("failed", "waiting") and ends else found.error)


def test_the_lease_of_a_process_that_was_killed_here_says_nothing(tmp_path):
    assert write(tmp_path, None, lease=socket.gethostname()).state == "cut off"


def test_a_lease_that_nobody_touches_any_more_says_nothing(tmp_path):
    assert write(tmp_path, None, lease="elsewhere").state == "running"
    os.utime(tmp_path / attempts.LEASE, (time.time() - 3600,) * 2)
    assert attempts.fate(pack_of(tmp_path)).state == "cut off"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["attempts.jsonl", "lease"], "a look leaves nothing"


def test_the_last_line_of_an_error_is_kept(tmp_path):
    assert write(tmp_path, (1, "Traceback\n  somewhere\nOSError: no space")).error == "OSError: no space"


def test_a_line_that_was_cut_short_is_left_out(tmp_path):
    write(tmp_path, (1, "x"))
    with (tmp_path / attempts.NAME).open("a") as file:
        file.write('{"at": "20')
    assert len(attempts.read(tmp_path)) == 2


@pytest.mark.parametrize(
    ("variables", "name"),
    [
        ({}, ""),
        ({"SLURM_ARRAY_JOB_ID": "7", "SLURM_ARRAY_TASK_ID": "3", "SLURM_JOB_ID": "9"}, "7_3"),
        ({"SLURM_JOB_ID": "9"}, "9"),
    ],
)
def test_a_task_is_called_as_its_engine_calls_it(variables, name, monkeypatch, tmp_path):
    for variable in ("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID", "SLURM_JOB_ID"):
        monkeypatch.delenv(variable, raising=False)
    for variable, value in (variables | {"SLURM_RESTART_COUNT": "2"}).items():
        monkeypatch.setenv(variable, value)
    attempts.begin(tmp_path)
    assert attempts.read(tmp_path)[0]["job"] == name and attempts.read(tmp_path)[0]["restarts"] == 2
