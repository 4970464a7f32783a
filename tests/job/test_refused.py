"""Bad input to a run is one sentence and exit code 2, and leaves nothing behind."""

import pytest

from srl_jax.cli import run as command

REFUSED = [
    (["--algos", "dqn"], "algos is 'dqn'"),
    (["--damage", "leg_zz"], "leg_zz"),
    (["--robot", "spot"], "robot is 'spot': choose one of phantomx, quadruped"),
    (["--robot", "quadruped", "--damage", "tibia_rf"], "leg_, hip_, thigh_ or shin_ followed by one of rf, rr, lf, lr"),
    (["--robot", "quadruped", "--algos", "ite", "--task", "x"], "robot is 'quadruped': ite and its repertoire are"),
    (["--robot", "quadruped", "--behaviour", "repertoire", "--task", "x"], "robot is 'quadruped': ite and its"),
    (["--robot", "quadruped", "--behaviour", "atlas"], "robot is 'quadruped': atlases are the phantomx's"),
    (["--robot", "quadruped", "--preset", "robot"], "robot is 'quadruped': atlases are the phantomx's"),
    (["--memory-gb", "0.5"], "memory_gb is 0.5"),
    (["--behaviour", "nowhere"], "behaviour is 'nowhere'"),
    (["--seeds", "0"], "seeds is '0'"),
    (["--preset", "smoke", "--task", "x", "--algos", "ite"], "env.episode_steps is 40: ite"),
    (["--evaluation.episodes", "0"], "evaluation.episodes is 0"),
]


def sentence(capsys, monkeypatch, *arguments):
    """The one line on stderr of a command that is refused."""
    monkeypatch.setattr(command, "use_devices", lambda wanted, lanes, **_: 2)
    with pytest.raises(SystemExit) as caught:
        command.main(list(arguments))
    assert caught.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize("arguments, message", REFUSED)
def test_refused_before_anything_is_written(arguments, message, capsys, monkeypatch, tmp_path):
    out = tmp_path / "out"
    assert message in sentence(capsys, monkeypatch, *arguments, "--out", str(out))
    assert not out.exists()


def test_a_directory_with_files_is_refused(capsys, monkeypatch, tmp_path):
    (tmp_path / "something").touch()
    assert "is not empty" in sentence(capsys, monkeypatch, "--out", str(tmp_path))


def test_resuming_with_other_settings_names_them(smoke_run, capsys, monkeypatch):
    line = sentence(capsys, monkeypatch, "--resume", str(smoke_run[0]), "--srl.dropout", "0.5", "--steps", "3200")
    assert "srl.dropout" in line and "steps" in line


def test_resuming_what_is_no_run(capsys, monkeypatch, tmp_path):
    assert "no config.json" in sentence(capsys, monkeypatch, "--resume", str(tmp_path))
