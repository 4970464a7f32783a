"""A whole run whose robots carry different damages: what its files, its students and its arithmetic say of it."""

import csv
import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.env.damage import build
from srl_jax.env.hexapod import observation_size
from srl_jax.job import export, memory, plan, students
from srl_jax.job.run import run
from srl_jax.program import strides
from tests.conftest import DEVICES
from tests.job.finished import numbers
from tests.program.mixed import MIX, K, config


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    made = tmp_path_factory.mktemp("mix") / "run"
    assert run(config(), made, DEVICES) is not None
    return made


@pytest.mark.slow
def test_a_lane_is_a_seed_and_is_judged_over_the_mix(directory):
    with (directory / "lanes.csv").open(newline="") as file:
        assert [(row["seed"], row["damage"]) for row in csv.DictReader(file)] == [("0", "mix"), ("1", "mix")]
    found = numbers(directory)
    judged = {metric for _, _, metric in found if metric.endswith("/return")}
    assert judged == {"healthy/return", "reference/return", "teacher/return", "eval/return", "train/return"}
    assert all(np.isfinite(value) for (_, _, metric), value in found.items() if not metric.startswith("train/"))
    assert found["0", "0", "healthy/distance"] > found["0", "0", "teacher/distance"], "pi_B is judged over the mix too"


@pytest.mark.slow
def test_a_video_shows_one_of_the_damages(directory):
    (shown,) = (directory / "videos").glob("*.mp4")
    assert shown.name.split("-")[1] in MIX


@pytest.mark.slow
def test_its_students_act_and_have_no_damage_of_their_own(directory):
    opened = students.open_run(directory)
    seen = np.linspace(-1.0, 1.0, observation_size("x", opened.config.env), dtype=np.float32)
    assert seen.shape == (25 + K * 39,)
    for lane in opened.lanes_of("srl"):
        (taken,) = export.from_run(directory, seed=lane.seed)
        assert taken.about["damage"] == "mix" and taken.about["history"] == K
        np.testing.assert_allclose(taken(seen), opened.policy(lane)(seen), atol=1e-5)
        with pytest.raises(
            ValueError, match=r"damage_mix=leg_rf,leg_lm,healthy: its lanes have no damage of their own"
        ):
            opened.damage(lane)


def test_what_damages_and_starts_take_is_counted():
    lanes = plan.make(config()).lanes
    own = sum(leaf.nbytes for leaf in jax.tree.leaves(build("healthy")))
    state = 4 * (77 + K * 39)
    assert memory.needed(config(), lanes, 1).mix == 2 * len(MIX) * (own + strides.COUNT * state)
    assert "GiB mix" in str(memory.needed(config(), lanes, 1))
    plain = dataclasses.replace(config(), damage_mix="", damage="leg_rf")
    said = memory.needed(plain, lanes, 1)
    assert said.mix == 0 and "mix" not in str(said)


def test_a_replay_grows_with_what_is_told_of_the_past():
    without = dataclasses.replace(config(), env=dataclasses.replace(config().env, history=0))
    rows = 160 // 4 * 4 + (160 // 4 // 6 + 2) * 4 + 4  # observations that a replay holds
    more = memory.replay_bytes(config(), 160) - memory.replay_bytes(without, 160)
    assert more == 4 * rows * ((25 + K * 39 + 1) // 2 - 13)
