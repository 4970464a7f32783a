"""Files of policies hold them to the last bit, and what is no such file is said to be none."""

import json

import numpy as np
import pytest

from srl_jax import portable
from tests.portable.made import policy


def same(found, expected):
    """Whether two policies have the same weights, to the last bit."""
    names = set(found.weights) | set(expected.weights)
    return all(np.array_equal(found.weights[name], expected.weights[name]) for name in names)


@pytest.mark.parametrize("name", ["two.npz", "two.json"])
def test_files_hold_them(name, tmp_path):
    each = [policy(), policy(layer_norm=False, hidden=(4,), seed=3)]
    portable.save(tmp_path / name, each)
    found = portable.load(tmp_path / name)
    assert [own.about.get("seed") for own in found] == [None, 3]
    assert all(map(same, found, each))
    assert all(value.dtype == np.float32 for own in found for value in own.weights.values())
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_half_a_file_holds_them_at_half_precision(tmp_path):
    own = policy()
    portable.save(tmp_path / "half.npz", [own], half=True)
    assert same(portable.load(tmp_path / "half.npz")[0], portable.rounded(own))


def test_a_text_is_for_people(tmp_path):
    own = portable.rounded(policy(task="x"), "coarse")
    portable.save(tmp_path / "one.json", [own])
    text = (tmp_path / "one.json").read_text()
    stored = json.loads(text)[0]
    assert stored["about"]["task"] == "x" and np.shape(stored["weights"]["0/kernel"]) == (7, 16)
    assert "],\n[" in text and max(map(len, text.splitlines())) < 250  # a row of a matrix a line
    numbers = [str(number) for number in stored["weights"]["0/bias"]]
    assert max(map(len, numbers)) <= 11  # -0.00390625 is a whole 1/256


@pytest.mark.parametrize("suffix", ["npz", "json"])
def test_what_is_no_such_file_is_one_sentence(suffix, tmp_path):
    with pytest.raises(ValueError, match=rf"none\.{suffix} does not exist: make policies with python -m srl_jax.export"):
        portable.load(tmp_path / f"none.{suffix}")
    for content in ("policy", "{}", "[]", "[{}]", '[{"about": {}, "weights": {}}]', '[{"weights": {"0/kernel": "x"}}]'):
        (tmp_path / f"text.{suffix}").write_text(content)
        with pytest.raises(ValueError, match=f"text.{suffix} cannot be read as policies"):
            portable.load(tmp_path / f"text.{suffix}")


@pytest.mark.parametrize("more", [{}, {"3/0/kernel": np.zeros((2, 2))}, {"x": np.zeros(2)}])
def test_arrays_of_something_else_are_no_policies(more, tmp_path):
    np.savez(tmp_path / "other.npz", about=np.array("[{}]"), **more)
    with pytest.raises(ValueError, match=r"other.npz cannot be read as policies"):
        portable.load(tmp_path / "other.npz")
