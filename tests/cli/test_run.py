"""The options of a run: presets, what a resumed run accepts, and algorithms from outside the package."""

import dataclasses

import pytest

from srl_jax.cli import run
from srl_jax.config import preset
from srl_jax.job import files
from tests.job.registered import MySettings, _mine  # noqa: F401  a fixture


@pytest.fixture
def stored(tmp_path):
    """The directory of a smoke run that has begun."""
    files.write_config(tmp_path, preset("smoke"), 2)
    return str(tmp_path)


@pytest.mark.parametrize("name", ["default", "paper", "robot", "smoke"])
def test_without_options_a_run_is_its_preset(name):
    assert run.parse(["--preset", name])[1] == run.parse([f"--preset={name}"])[1] == preset(name)


def test_options_stand_on_top_of_the_preset():
    arguments, config = run.parse(["--preset", "smoke", "--srl.dropout", "0.1,0.2", "--steps", "3200", "--out", "x"])
    base = preset("smoke")
    assert config == dataclasses.replace(base, steps=3200, srl=dataclasses.replace(base.srl, dropout=(0.1, 0.2)))
    assert (arguments.out, arguments.resume) == ("x", "")


@pytest.mark.parametrize("options", [["--physics", "mjx"], ["--physics=mjx"], ["--env.physics", "mjx"]])
def test_physics_needs_no_section(options):
    base = preset("smoke")
    expected = dataclasses.replace(base, env=dataclasses.replace(base.env, physics="mjx"))
    assert run.parse(["--preset", "smoke", *options])[1] == expected


def test_another_physics_is_refused_in_one_sentence(capsys):
    with pytest.raises(SystemExit) as ended:
        run.main(["--physics", "warp"])
    assert ended.value.code == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert "invalid choice 'warp' for argument '--env.physics'. Expected one of ('auto', 'star', 'mjx')." in said


def test_a_resumed_run_keeps_its_settings_but_not_its_devices(stored):
    assert run.parse(["--resume", stored])[1] == preset("smoke")
    assert run.parse(["--resume", stored, "--devices", "4"])[1] == dataclasses.replace(preset("smoke"), devices="4")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--steps", "3200", "--srl.dropout", "0.5"], "steps, srl.dropout"),
        (["--out", "elsewhere"], "out"),
        (["--preset", "paper"], "preset"),
    ],
)
def test_what_a_resumed_run_does_not_accept_is_named(options, named, stored):
    with pytest.raises(ValueError, match=rf"resume .*: {named} differ from the run's own"):
        run.parse(["--resume", stored, *options])


def test_a_registered_algorithm_has_options_of_its_own(mine, capsys):
    _, config = run.parse(["--algos", "srl,mine", "--mine.rate", "0.1,0.2"])
    assert config.agent("mine") == MySettings(rate=(0.1, 0.2))
    with pytest.raises(SystemExit):
        run.parse(["--help"])
    printed = capsys.readouterr().out
    assert "--mine.rate" in printed and "How fast it goes." in printed and "Train DDPG and SRL" in printed


def test_a_registered_algorithm_survives_the_file(mine, tmp_path):
    _, config = run.parse(["--algos", "mine", "--mine.layers", "3"])
    files.write_config(tmp_path, config, 1)
    assert run.parse(["--resume", str(tmp_path)])[1] == config
    with pytest.raises(ValueError, match=r"mine\.rate differ"):
        run.parse(["--resume", str(tmp_path), "--mine.rate", "0.1"])


def test_an_algorithm_that_a_run_does_not_use_is_not_stored(mine):
    assert run.parse(["--algos", "srl", "--mine.layers", "3"])[1].more == {}
