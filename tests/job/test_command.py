"""The command of a run gives the same run, whatever was asked; settings of another version have none."""

import dataclasses
import shlex
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

from srl_jax.cli import atlas, run
from srl_jax.config import Config, Preset, preset
from srl_jax.job import command
from tests.job.registered import _mine  # noqa: F401  a fixture


def parsed(text):
    """The configuration that a command line stands for."""
    program, verb, *words = shlex.split(text)
    assert (program, verb) == ("srl-jax", "run")
    return run.parse(words)[1]


def other(hint, value):
    """Another value of the same type; a string stays, for few are accepted."""
    if get_origin(hint) is Literal:
        return next((choice for choice in get_args(hint) if choice != value), value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, tuple):
        return (*value[1:], value[0] / 3 + 1e-7) if isinstance(value[0], float) else (*value, 7)
    return value if isinstance(value, str) else value * 3 + 1


def changed(settings):
    """A dataclass of which every field has another value, sections included."""
    hints = get_type_hints(type(settings))
    values = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}
    return dataclasses.replace(
        settings,
        **{
            name: changed(value) if dataclasses.is_dataclass(value) else other(hints[name], value)
            for name, value in values.items()
            if name != "more"
        },
    )


@pytest.mark.parametrize("name", get_args(Preset))
def test_a_preset_is_its_name_alone(name):
    asked = command.asked(command.plain(preset(name)))
    assert (asked.preset, asked.changes) == (name, [])
    assert asked.command == "srl-jax run" + ("" if name == "default" else f" --preset {name}")


def test_every_setting_survives_the_command():
    config = changed(preset("default"))
    assert len(command.nearest(command.plain(config))[1]) > 100
    assert parsed(command.again(config)) == config


@pytest.mark.parametrize(
    "words",
    [
        "--task x --damage leg_rm+leg_lf,coxa_rr:limp --seeds 3, --srl.dropout 0.1,0.2 --srl.no-commit",
        "--preset smoke --damage-schedule healthy@0,leg_rm@800 --part 2/3 --ddpg-warm.hidden 8 --devices 2",
        "--preset robot --behaviour 'runs/my run,gait' --env.goal-ring 1.0 2.0 --env.effort-weight=-0.5",
    ],
)
def test_a_command_leads_back_to_itself(words):
    config = run.parse(shlex.split(words))[1]
    assert parsed(command.again(config)) == config


def test_an_atlas_is_a_run_as_well():
    config = atlas.configured(atlas.Arguments(damages="leg_rm", preset="smoke", steps=1600))
    assert parsed(command.again(config)) == config


def test_an_algorithm_from_outside_the_package_has_its_options(mine):
    config = run.parse(["--algos", "mine", "--mine.rate", "0.1,0.2"])[1]
    asked = command.asked(command.plain(config))
    assert [change.name for change in asked.changes] == ["algos", "mine.rate"]
    assert parsed(asked.command) == config


def test_what_differs_is_told_with_the_presets_value():
    settings = command.plain(dataclasses.replace(preset("smoke"), seeds="7"))
    (change,) = command.asked(settings, "a point").changes
    assert change == ("seeds", "7", "2")


def test_settings_of_another_version_are_told_but_give_no_command():
    settings = command.plain(Config()) | {"warp": 9}
    del settings["evaluation"]
    asked = command.asked(settings)
    assert asked.command == "" and list(asked.changes) == [("warp", 9, None)]
