"""The verb `recover`: the story that is told, and bad input in one sentence."""

import pytest

from srl_jax.atlas import file
from srl_jax.cli import recover
from tests.conftest import DEVICES


def test_the_story_is_told_step_by_step(atlas, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(recover, "use_devices", lambda wanted, **_: DEVICES)  # jax has started
    file.save(tmp_path / "atlas.npz", atlas)
    words = ["--atlas", str(tmp_path / "atlas.npz"), "--damage", "leg_lf+leg_lr", "--strike", "0.4", "--seconds", "1.6"]
    assert recover._main(words) == 0
    told = capsys.readouterr().out
    assert "leg_lf+leg_lr strikes after 0.4 s; it was never foreseen." in told
    assert "0.4* " in told and "leg_lf+leg_lr (put together)" in told
    assert "Before " in told and " m/s" in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--strike", "9", "--seconds", "3"], "strike is 9.0: it must be at least 0 and less than seconds=3.0"),
        (["--atlas", "none.npz"], "none.npz does not exist: make an atlas"),
        (["--damage", "arm_rm"], "unknown part 'arm_rm'"),
    ],
)
def test_bad_input_gets_one_sentence(words, said, capsys, monkeypatch):
    monkeypatch.setattr(recover, "use_devices", lambda wanted, **_: DEVICES)
    with pytest.raises(SystemExit) as ended:
        recover.main(words)
    assert ended.value.code == 2 and said in capsys.readouterr().err
