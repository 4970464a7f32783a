"""How a pack stands, told from its files alone."""

import pytest

from srl_jax.sweep import attempts


def write(tmp_path, *ends, lease=False, done=False):
    for end in ends:
        attempts.begin(tmp_path)
        if end is not None:
            attempts.end(tmp_path, *end)
    if lease:
        (tmp_path / attempts.LEASE).touch()
    if done:
        (tmp_path / "summary.json").touch()
    return attempts.fate(tmp_path, tmp_path)


def test_fates(tmp_path):
    ends = {
        "never": ([], {}, "waiting"),
        "now": ([None], {"lease": True}, "running"),
        "killed": ([None], {}, "cut off"),
        "stopped": ([(143, "stopped and saved")], {}, "waiting"),
        "bad": ([(2, "seeds is x")], {}, "failed"),
        "again": ([(1, "disk full"), None], {"lease": True}, "running"),
        "done": ([(1, "disk full"), (0, "")], {"done": True}, "done"),
    }
    for name, (lines, facts, state) in ends.items():
        found = write(tmp_path / name, *lines, **facts) if lines else attempts.fate(tmp_path / name, tmp_path / name)
        assert found.state == state and found.attempts == len(lines), name


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
    for variable in ("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID", "SLURM_JOB_ID", "RAY_JOB_ID"):
        monkeypatch.delenv(variable, raising=False)
    for variable, value in (variables | {"SLURM_RESTART_COUNT": "2"}).items():
        monkeypatch.setenv(variable, value)
    attempts.begin(tmp_path)
    assert attempts.read(tmp_path)[0]["job"] == name and attempts.read(tmp_path)[0]["restarts"] == 2
