"""The verb `atlas`: the run that is configured, what may be resumed, and what is recorded."""

import dataclasses

import pytest

from srl_jax.cli import atlas as atlas_verb
from srl_jax.cli.atlas import Arguments
from srl_jax.config import preset
from srl_jax.job import files, plan


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


@pytest.fixture
def begun(tmp_path):
    """The directory of an atlas that was stopped at once."""
    arguments = Arguments(damages="losses21", steps=20_000, preset="smoke", devices="1")
    files.write_config(tmp_path, atlas_verb.configured(arguments), 1)
    return str(tmp_path)


def test_a_resumed_atlas_keeps_its_settings(begun):
    arguments, config = atlas_verb.parse(["--resume", begun, "--devices", "2"])
    assert (config.damage, config.steps, config.devices) == ("healthy,losses21", 20_000, "2")
    assert atlas_verb.asked(arguments) == "srl-jax atlas --damages healthy,losses21 --steps 20000 --preset smoke"
    for option, value in (("--steps", "7"), ("--damages", "all"), ("--out", "elsewhere")):
        with pytest.raises(ValueError, match=f"{option[2:]} differ from the atlas' own"):
            atlas_verb.parse(["--resume", begun, option, value])


def test_a_run_of_another_kind_is_not_resumed_as_an_atlas(tmp_path):
    files.write_config(tmp_path, dataclasses.replace(preset("smoke"), damage="healthy"), 1)
    with pytest.raises(ValueError, match="it is no atlas' run; go on with it by srl-jax run --resume"):
        atlas_verb.parse(["--resume", str(tmp_path)])
