"""The policies that ship: what there is, that none of it needs jax, and what is not there."""

import subprocess
import sys

import numpy as np
import pytest

from srl_jax import pretrained
from srl_jax.env.damage_names import HEALTHY, catalogue, task_set
from srl_jax.env.interface import CONTROL_HZ, layout
from srl_jax.show.walk import Walk
from srl_jax.show.walker import by_policy, tripod

LARGEST, ALL = 250_000, 400_000  # bytes of a file, and of all that runs have left


def test_what_ships():
    there = pretrained.names()
    assert len(set(there)) == len(there)
    for task in ("x", "p2p"):
        for name in ("srl", "ddpg"):
            assert {own.damage for own in there if own[:2] == (name, task)} == {HEALTHY, *task_set(task)}
    assert {own.damage for own in there if own[:2] == ("atlas", "x")} == set(catalogue())


def test_files_are_small():
    sizes = [path.stat().st_size for path in pretrained.FOLDER.glob("*.npz")]
    assert len(sizes) == 2 and max(sizes) <= LARGEST and sum(sizes) <= ALL


@pytest.mark.parametrize("own", pretrained.names()[::9], ids=str)
def test_each_is_a_policy_for_what_it_says(own):
    policy = pretrained.load(own.name, task=own.task, damage=own.damage)
    about = policy.about
    assert (about["task"], about["damage"]) == (own.task, own.damage)
    assert [tuple(part) for part in about["observation"]] == layout(own.task, about["kind"])
    assert policy.observation_size == sum(size for _, size in layout(own.task, about["kind"]))
    seen = np.random.default_rng(0).normal(size=(20, policy.observation_size))
    assert policy(seen).shape == (20, 18) and np.std(policy(seen)) > 0.1


def test_a_damage_may_be_spelled_otherwise():
    assert pretrained.load("srl", task="p2p", damage=" coxa_rm") is pretrained.load("srl", task="p2p", damage="leg_rm")


def test_nothing_of_it_needs_jax():
    program = """
import sys
for name in ("jax", "jaxlib", "flax", "mujoco", "optax", "orbax"):
    sys.modules[name] = None
import srl_jax
for name, task, damage in srl_jax.pretrained.names():
    policy = srl_jax.pretrained.load(name, task=task, damage=damage)
    assert policy([0.0] * policy.observation_size).shape == (18,)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    ("name", "task", "damage", "message"),
    [
        ("sarl", "x", "leg_rm", "name is 'sarl': there are ddpg, srl, atlas"),
        ("srl", "xy", "leg_rm", "task is 'xy': srl has p2p, x"),
        ("srl", "x", "leg_rm", "damage is 'leg_rm': srl for x has healthy, tibia_rf, "),
        ("atlas", "x", "leg_rf+leg_rm+leg_rr", r"atlas for x has 76, which srl_jax.pretrained.names\(\) lists"),
        ("srl", "p2p", "knee", "unknown part 'knee'"),
    ],
)
def test_what_is_not_there_is_one_sentence(name, task, damage, message):
    with pytest.raises(ValueError, match=message):
        pretrained.load(name, task=task, damage=damage)


@pytest.mark.parametrize(("task", "damage", "seconds"), [("x", "tibia_rm", 5.0), ("p2p", "leg_rm", 8.0)])
def test_they_walk_where_the_tripod_limps(task, damage, seconds):
    steps = round(seconds * CONTROL_HZ)
    walkers = [tripod(task), by_policy(pretrained.load("srl", task=task, damage=damage))]
    lame, own = (list(Walk(walker, damage, strike=0).until(steps))[-1] for walker in walkers)
    assert not own.fell
    assert own.reached > max(lame.reached, 1) if task == "p2p" else own.qpos[0] > 1.5 * lame.qpos[0]
