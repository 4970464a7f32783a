"""pi_B out of an atlas: the best for a lane's damage, with or without what was trained for it."""

import dataclasses

import jax
import numpy as np
import pytest

from srl_jax.atlas import file, recovery
from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.job import teachers
from srl_jax.program.lanes import Lane


@pytest.fixture(scope="module")
def path(atlas, tmp_path_factory):
    path = tmp_path_factory.mktemp("atlas") / "atlas.npz"
    file.save(
        path, atlas._replace(speed=np.float32([[5, 1, 1, 1], [1, 4, 3, 1], [1, 2, 5, 1], [2, 3, 1, 4]])), half=False
    )
    return path


def config(**fields):
    base = dataclasses.replace(preset("smoke"), task="x", env=EnvConfig(observation="onboard"))
    return dataclasses.replace(base, **fields)


def weights(teacher, names):
    params = teacher.params([Lane(i, "srl", 0, "x", name) for i, name in enumerate(names)])
    return telling(params)


def telling(actors):
    """An array of networks' in which no two of them are alike; biases are all 0 at first."""
    return max(jax.tree.leaves(actors), key=np.size)


@pytest.mark.parametrize(("kind", "best"), [("atlas", [1, 2, 0]), ("atlas-others", [3, 1, 3])])
def test_every_lane_has_the_best_policy_for_its_damage(atlas, path, kind, best):
    made = config(behaviour=f"{kind}:{path}", algos="srl", damage="leg_rm")
    teachers.check(made)
    (teacher,) = teachers.load(made, path.parent, lambda *_: True)
    found = weights(teacher, ["leg_rm", "femur_lf:limp", "healthy"])
    np.testing.assert_array_equal(found, telling(atlas.actors)[best])
    assert teacher.architecture == ((8, 8), True)


def test_what_the_matrix_lacks_is_walked_in_simulation_once_for_all_lanes_of_a_damage(atlas, path, monkeypatch):
    asked = []

    def imagine(known, actors, own, *, mind):
        asked.append((mind.task, own.body_mass.shape, len(jax.tree.leaves(actors)[0])))
        return np.float32([3, 4, 0, 5])

    monkeypatch.setattr(recovery, "_imagine", imagine)
    (teacher,) = teachers.load(config(behaviour=f"atlas:{path}"), path.parent, lambda *_: True)
    found = weights(teacher, ["leg_lm+tibia_rf:weak=0.5"] * 2)
    np.testing.assert_array_equal(found, telling(atlas.actors)[[3, 3]])
    assert asked == [("x", (20,), 4)]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"task": "p2p"}, "its atlas was made with task=x, not p2p"),
        ({"env": EnvConfig(observation="full")}, "made with observation=onboard, not full"),
        ({"damage_schedule": "healthy@0,leg_rm@800"}, "leave damage_schedule out"),
        ({"damage_mix": "losses21"}, "leave damage_mix out"),
        ({"env": EnvConfig(observation="onboard", history=2)}, "its policies see no history; leave env.history=2 out"),
    ],
)
def test_an_atlas_that_does_not_fit_is_refused(path, fields, said):
    with pytest.raises(ValueError, match=said):
        teachers.check(config(behaviour=f"atlas:{path}", **fields))
    with pytest.raises(ValueError, match="does not exist"):
        teachers.check(config(behaviour="atlas:nowhere.npz"))
