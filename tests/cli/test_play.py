"""The verb play: which policy is shown, the video that is left, and what is refused."""

import dataclasses

import imageio_ffmpeg
import pytest

from srl_jax import portable, pretrained
from srl_jax.cli import play

verb = play


def test_a_video_is_left(asked, tmp_path):
    code, said = asked("--strike", 0.2, "--seconds", 0.4, "--out", "deep/walk.mp4")
    assert code == 0 and said.out.splitlines()[-1] == "Video: deep/walk.mp4"
    assert said.out.startswith("healthy: tripod walks ") and "leg_rm: atlas for leg_rm walks " in said.out
    assert imageio_ffmpeg.count_frames_and_secs(tmp_path / "deep" / "walk.mp4")[0] == 8 + 10


@pytest.mark.parametrize(("algo", "expected"), [("", "srl"), ("ddpg", "ddpg")])
def test_of_a_run_or_file_the_policy_for_the_damage_is_shown(algo, expected, finished, tmp_path):
    arguments = play.Arguments(task="p2p", policy=str(finished), algo=algo)
    found = play.chosen(arguments, "leg_lf")
    assert (found.about["algo"], found.about["damage"], found.about["seed"]) == (expected, "leg_lf", 0)
    each = [dataclasses.replace(found, about=found.about | {"damage": name}) for name in ("leg_rm", "leg_lf")]
    portable.save(tmp_path / "own.json", each)
    again = play.chosen(dataclasses.replace(arguments, policy=str(tmp_path / "own.json")), "leg_lf")
    assert again.about["damage"] == "leg_lf"


def test_names_are_those_that_ship():
    found = play.chosen(play.Arguments(task="p2p", policy="ddpg"), "leg_rm")
    assert {own.name for own in pretrained.names()} == set(play.SHIPPED)
    assert found is pretrained.load("ddpg", task="p2p", damage="leg_rm")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--damage", "knee"], "unknown part 'knee'"),
        (["--strike", "15"], "strike is 15.0: it must be at least 0, and a control step"),
        (["--strike", "0", "--seconds", "inf"], "less than seconds=inf"),
        (["--out", "walk.gif"], "out is walk.gif: give a file that ends in .mp4"),
        (["--policy", "sarl"], "policy is 'sarl': give tripod, atlas, srl, ddpg, the directory of a finished run"),
        (["--policy", "none.npz"], "none.npz does not exist"),
        (["--policy", "."], "config.json"),
        (["--policy", "srl"], "damage is 'leg_rm': srl for x has healthy, tibia_rf"),
        (["--policy", "RUN"], "task is x: RUN was trained for p2p"),
        (["--policy", "RUN", "--task", "p2p", "--damage", "leg_rf"], "damage is 'leg_rf': RUN has policies for leg_rm"),
        (["--policy", "RUN", "--task", "p2p", "--algo", "bac"], "algo is 'bac': RUN has ddpg, srl"),
    ],
)
def test_bad_input_is_one_sentence(words, message, finished, asked, tmp_path):
    code, said = asked(*(finished if word == "RUN" else word for word in words))
    assert code == 2 and message.replace("RUN", str(finished)) in said.err and said.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
