"""The verbs `recover` and `atlas`: the story that is told, the run that is configured, bad input in one sentence."""

import pytest

from srl_jax.atlas import file
from srl_jax.cli import atlas as atlas_verb
from srl_jax.cli import recover
from srl_jax.cli.atlas import Arguments
from srl_jax.job import plan
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


def test_the_run_of_an_atlas_has_the_healthy_robot_and_starts_in_mid_stride():
    config = atlas_verb.configured(Arguments(damages="losses21", steps=20_000, guidance_weight=2.0))
    assert config.damage == "healthy,losses21" and config.algos == "srl" and config.steps == 20_000
    assert (config.env.observation, config.env.stride_starts) == ("onboard", 0.5)
    assert config.srl.guidance_weight == (2.0,) and config.train.checkpoint_every == 5_000
    assert atlas_verb.configured(Arguments(damages="all")).damage == "all"
    with pytest.raises(ValueError, match="steps is 7"):
        plan.make(atlas_verb.configured(Arguments(steps=7)))


def test_the_command_that_is_recorded_names_no_place():
    asked = atlas_verb.asked(Arguments(damages="all,triples", steps=100_000, out="somewhere", devices="1"))
    assert asked == "srl-jax atlas --damages all,triples --steps 100000"
