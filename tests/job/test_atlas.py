"""An atlas from a run: its students in the order of their damages, judged under all of them."""

import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.atlas import file
from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.job import atlas
from tests.job.untrained import write


def config_of(damage, observation="onboard", history=0):
    base, env = preset("smoke"), EnvConfig(observation=observation, history=history)
    return dataclasses.replace(base, task="x", algos="srl", seeds="1", damage=damage, env=env)


@pytest.mark.slow
def test_it_has_every_student_under_every_damage(tmp_path, monkeypatch):
    monkeypatch.setattr(atlas, "WALKS", 1)
    monkeypatch.setattr(atlas, "STEPS", 5)
    actors = write(config_of("leg_rm,healthy,tibia_lf:limp"), tmp_path / "run")
    made = atlas.from_run(tmp_path / "run", tmp_path / "atlas.npz", command="srl-jax atlas")
    assert made.damages == made.trained_for == ("healthy", "leg_rm", "tibia_lf:limp")
    for row, lane in enumerate((1, 0, 2)):
        own = jax.tree.map(lambda x, row=row: x[row], made.actors)
        jax.tree.map(np.testing.assert_array_equal, own, jax.device_get(actors[lane]))
    assert made.speed.shape == made.falls.shape == (3, 3) and np.isfinite(made.speed).all()
    assert np.isfinite(made.whitening).all() and np.all(np.diag(made.whitening) > 0.0)
    assert file.load(tmp_path / "atlas.npz").about == made.about


def test_a_run_that_is_no_atlas_says_why(tmp_path):
    write(config_of("leg_rm"), tmp_path / "lame")
    with pytest.raises(ValueError, match="has no healthy lane"):
        atlas.from_run(tmp_path / "lame", tmp_path / "atlas.npz")
    write(config_of("healthy", "full"), tmp_path / "full")
    with pytest.raises(ValueError, match=r"env\.observation=full, which no robot senses"):
        atlas.from_run(tmp_path / "full", tmp_path / "atlas.npz")
    write(config_of("healthy", history=1), tmp_path / "history")
    with pytest.raises(ValueError, match=r"env\.history=1; an atlas' policies see none"):
        atlas.from_run(tmp_path / "history", tmp_path / "atlas.npz")
    assert not (tmp_path / "atlas.npz").exists()
