"""The README's animation, from a run that never learned, in its smallest form."""

import dataclasses

import pytest
from PIL import Image

from experiments import walking
from srl_jax.config import preset
from tests.job.untrained import write


def written(directory, **changed):
    write(dataclasses.replace(preset("smoke"), seeds="1", damage="leg_rm", **changed), directory)
    return directory


@pytest.mark.slow
def test_four_robots_are_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(walking, "use_devices", lambda *_, **__: 1)
    monkeypatch.setattr(walking, "BEFORE", 4)
    monkeypatch.setattr(walking, "AFTER", 24)
    run = written(tmp_path / "run", task="x", algos="ddpg,srl")
    walking.main(walking.Args(run, tmp_path / "four.webp", width=48, height=32, every=7))
    with Image.open(tmp_path / "four.webp") as drawn:
        assert drawn.size == (96, 112) and getattr(drawn, "n_frames", 1) == 4


def test_another_run_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(walking, "use_devices", lambda *_, **__: 1)
    with pytest.raises(ValueError, match="it must be of --algos ddpg,srl on --task x"):
        walking.main(walking.Args(written(tmp_path / "run", algos="ddpg,srl"), tmp_path / "four.webp"))
