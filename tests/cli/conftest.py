"""What the tests of verbs share: a finished run, and asking a verb as a user would."""

import dataclasses

import pytest

from srl_jax.config import preset
from tests.job.untrained import write


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The directory of a smoke run of DDPG and SRL, two damages and two seeds."""
    directory = tmp_path_factory.mktemp("finished") / "run"
    write(dataclasses.replace(preset("smoke"), damage="leg_rm,leg_lf", algos="ddpg,srl"), directory)
    return directory


@pytest.fixture
def asked(request, capsys, monkeypatch, tmp_path):
    """(words) -> exit code and what was printed by the test module's `verb`, in an empty folder."""
    verb = request.module.verb
    monkeypatch.setattr(verb, "use_devices", lambda *_, **__: 1)  # jax has started
    monkeypatch.chdir(tmp_path)

    def ask(*words):
        with pytest.raises(SystemExit) as ended:
            verb.main([str(word) for word in words])
        return ended.value.code, capsys.readouterr()

    return ask
