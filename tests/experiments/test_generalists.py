"""Generalists beside the atlas: finished runs by name, each a method, or a sentence that says what is missing."""

import dataclasses
import json
from pathlib import Path

import pytest

from experiments import recovery
from experiments.recovering import generalists
from experiments.recovering.rows import Case
from srl_jax.atlas import file
from srl_jax.atlas.robots import CRobot, World
from tests.conftest import DEVICES
from tests.job.untrained import write
from tests.program.mixed import K, config


def plain(history=0, **changes):
    """Whose episodes start standing: robots in mid-stride take long to compile, and nothing here asks for them."""
    env = dataclasses.replace(config().env, history=history, stride_starts=0.0, **changes)
    return dataclasses.replace(config(), env=env)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """One that remembers, and one that does not."""
    folder = tmp_path_factory.mktemp("generalists")
    write(plain(history=K), folder / "history")
    write(plain(), folder / "plain")
    return folder / "history", folder / "plain"


@pytest.mark.slow
def test_every_run_is_a_method_of_its_own(runs, atlas, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(recovery, "use_devices", lambda wanted, **_: DEVICES)  # jax has started
    file.save(tmp_path / "atlas.npz", atlas)
    args = recovery.Args(
        tmp_path / "atlas.npz",
        rows=("foreseen",),
        methods=("generalist",),
        generalists=runs,
        robots=21,
        seconds=0.5,
        out=str(tmp_path / "numbers.json"),
        figure=str(tmp_path / "figure.png"),
    )
    recovery.main(args)
    names = ["generalist history 2", "generalist"]
    kept = json.loads((tmp_path / "numbers.json").read_text())["retained"]["foreseen"]
    assert list(kept) == names and kept[names[0]] != kept[names[1]]
    printed = capsys.readouterr().out
    assert printed.count("trained on the damage of 0.10 of these robots") == 2, "two of the 21"
    assert f"{names[0]} kept more than {names[1]}" in printed and (tmp_path / "figure.png").exists()


@pytest.mark.slow
def test_seeds_take_robots_in_turn(runs):
    (walk,) = generalists.methods(runs[:1]).values()
    lots = [Case("leg_rf", (), World())] * 3
    bodies = [CRobot("leg_rf", 2, seed=0) for _ in lots]
    walk(lots, bodies, 0.3)
    first, second, third = (body.positions[-1] for body in bodies)
    assert abs(first - second).max() > 1e-3, "another seed's policy"
    assert [len(body.positions) for body in bodies] == [6] * 3 and third.shape == first.shape


def test_runs_of_one_kind_are_told_apart(runs):
    assert list(generalists.methods([runs[1], runs[1]])) == ["generalist", "generalist plain"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"damage_mix": "", "damage": "healthy"}, r"damage_mix='', .* a mix, x, and onboard or rates are needed"),
        ({"env": plain(observation="full").env}, "env.observation=full: a mix, x, and onboard"),
        ({"task": "p2p"}, "task=p2p and"),
    ],
)
def test_runs_that_cannot_walk_these_robots_are_refused(changes, said, tmp_path):
    write(dataclasses.replace(plain(), **changes), tmp_path / "run")
    with pytest.raises(ValueError, match=said):
        generalists.methods([tmp_path / "run"])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"methods": ("generalist",)}, "generalists is empty: generalist needs finished runs"),
        (
            {"methods": ("healthy",), "generalists": (Path("run"),)},
            "methods lacks generalist: add it, or leave them out",
        ),
        ({"methods": ("generalist",), "generalists": (Path("nowhere"),)}, "nowhere is not the directory of a run"),
        ({"methods": ("specialist",)}, "methods has specialist: choose from .*generalist"),
    ],
)
def test_bad_input_is_one_sentence(changes, said, atlas, tmp_path, monkeypatch):
    monkeypatch.setattr(recovery, "use_devices", lambda wanted, **_: DEVICES)
    file.save(tmp_path / "atlas.npz", atlas)
    with pytest.raises(ValueError, match=said):
        recovery.main(recovery.Args(tmp_path / "atlas.npz", **changes))
