"""The verb `recover`: the story that is told, and bad input in one sentence."""

import pytest

from srl_jax.atlas import file
from srl_jax.cli import recover
from tests.conftest import DEVICES


def test_the_story_is_told_step_by_step(atlas, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(recover, "use_devices", lambda wanted, **_: DEVICES)  # jax has started
    file.save(tmp_path / "atlas.npz", atlas)
    words = ["--atlas", str(tmp_path / "atlas.npz"), "--damage", "leg_lf+leg_lr", "--strike", "0.4", "--seconds", "1.6"]
    assert recover._main([*words, "--no-learn"]) == 0
    told = capsys.readouterr().out
    assert "leg_lf+leg_lr strikes after 0.4 s; the atlas knows nothing of it." in told
    assert "0.4* " in told and "leg_lf+leg_lr (put together)" in told
    assert "With the atlas: before " in told and "Without: before " in told and " m/s" in told


def test_a_figure_and_a_video_are_left_and_what_is_held_out_is_not_known(atlas, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(recover, "use_devices", lambda wanted, **_: DEVICES)
    file.save(tmp_path / "atlas.npz", atlas)
    words = ["--atlas", str(tmp_path / "atlas.npz"), "--damage", "held-out", "--strike", "0.2", "--seconds", "0.6"]
    assert recover._main([*words, "--no-learn", "--physics", "mjx", "--out", str(tmp_path / "seen")]) == 0
    assert "the atlas knows nothing of it" in capsys.readouterr().out
    assert (tmp_path / "seen" / "recovery.png").stat().st_size > 10_000
    assert (tmp_path / "seen" / "recovery.mp4").stat().st_size > 5_000


def test_mjxs_robot_has_no_goals(atlas, tmp_path, monkeypatch):
    monkeypatch.setattr(recover, "use_devices", lambda wanted, **_: DEVICES)
    file.save(tmp_path / "goals.npz", atlas._replace(about=atlas.about | {"task": "p2p"}))
    with pytest.raises(ValueError, match="physics is 'mjx': its robot walks straight ahead, and the atlas is for p2p"):
        recover._main(["--atlas", str(tmp_path / "goals.npz"), "--physics", "mjx"])


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
