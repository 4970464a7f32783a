"""Policies as plain arrays act as they did in jax, and their files hold them."""

import dataclasses
from functools import partial

import jax
import numpy as np
import pytest

from srl_jax import portable
from srl_jax.agents import ddpg
from srl_jax.agents.settings import DDPGConfig
from srl_jax.job.export import layers

OBSERVATION = [("clock", 2), ("joints", 5)]


def policy(layer_norm, hidden=(16, 8)):
    config = DDPGConfig(hidden=hidden, layer_norm=layer_norm)
    actor = ddpg.init(jax.random.key(1), 7, 3, config=config).actor
    moved = jax.tree.map(lambda x: x + 0.3 * jax.random.normal(jax.random.key(x.size), x.shape), actor)
    return portable.Policy(layers(moved), {"observation": OBSERVATION}), partial(ddpg.student, moved, config=config)


@pytest.mark.parametrize("layer_norm", [True, False])
def test_it_acts_as_in_jax(layer_norm):
    own, student = policy(layer_norm)
    seen = np.random.default_rng(0).normal(size=(50, 7)).astype(np.float32)
    expected = np.asarray(jax.vmap(student)(seen))
    np.testing.assert_allclose(own(seen), expected, atol=1e-5)
    np.testing.assert_allclose(own(seen[3]), expected[3], atol=1e-5)
    assert np.std(expected) > 0.1


def test_another_observation_is_refused():
    own, _ = policy(True)
    with pytest.raises(ValueError, match=r"shape \(6,\): this policy reads 7 numbers, clock \(2\), joints \(5\)"):
        own(np.zeros(6))


def test_files_hold_them(tmp_path):
    each = [policy(True)[0], dataclasses.replace(policy(False, (4,))[0], about={"observation": OBSERVATION, "seed": 3})]
    portable.save(tmp_path / "two.npz", each)
    found = portable.load(tmp_path / "two.npz")
    seen = np.ones(7, np.float32)
    assert [own.about.get("seed") for own in found] == [None, 3]
    assert all((own(seen) == before(seen)).all() for own, before in zip(found, each, strict=True))
    portable.save(tmp_path / "half.npz", each, half=True)
    assert all(
        (own(seen) == portable.rounded(before)(seen)).all()
        for own, before in zip(portable.load(tmp_path / "half.npz"), each, strict=True)
    )


def test_what_is_no_such_file_is_one_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"none\.npz does not exist"):
        portable.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("policy")
    np.savez(tmp_path / "other.npz", about=np.array("[{}]"))
    for name in ("text.npz", "other.npz"):
        with pytest.raises(ValueError, match=f"{name} cannot be read as policies"):
            portable.load(tmp_path / name)
