"""The verb export: what it writes, what it says of it, and what is refused."""

import numpy as np
import pytest

from srl_jax import portable
from srl_jax.atlas import stored
from srl_jax.cli import export

verb = export


def test_a_run_as_one_file(finished, asked, tmp_path):
    damage = ("--damage", "coxa_rm", "leg_lf")
    words = ("--algo", "srl", "--seed", 1, *damage, "--format", "json", "--out", "deep/own.json")
    code, said = asked(finished, *words)
    found = portable.load(tmp_path / "deep" / "own.json")
    assert code == 0 and [own.about["damage"] for own in found] == ["leg_rm", "leg_lf"]
    first, _, last = said.out.splitlines()
    assert first == "srl for p2p, leg_rm, seed 1: reads 51 numbers (full)"
    size = (tmp_path / "deep" / "own.json").stat().st_size
    assert last == f"deep/own.json: 2 policies, {size / 1e3:.1f} kB."


def test_the_atlas_that_ships(asked, tmp_path):
    code, said = asked("--damage", "leg_rm", "healthy", "--precision", "coarse")
    found = portable.load(tmp_path / "policies.npz")
    expected = stored.policies(stored.read())
    assert code == 0 and [own.about["damage"] for own in found] == ["healthy", "leg_rm"] and "2 policies" in said.out
    off = found[1].weights["0/kernel"] - expected["leg_rm"].weights["0/kernel"]
    assert 0.0 < np.abs(off).max() <= 1 / 512 + 1e-3


def test_graphs_lie_in_a_file_each(finished, asked, tmp_path):
    code, said = asked(finished, "--format", "onnx", "--seed", 0, "--damage", "leg_rm")
    assert code == 0 and said.out.splitlines()[-1].startswith("policies: 2 policies, ")
    names = {f"{algo}-p2p-leg_rm-seed0.onnx" for algo in ("ddpg", "srl")}
    assert {path.name for path in (tmp_path / "policies").iterdir()} == names
    assert asked("--format", "onnx", "--damage", "leg_rm", "--out", "one.onnx")[0] == 0
    assert (tmp_path / "one.onnx").stat().st_size > 20_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.npz"], "nowhere.npz does not exist"),
        (["RUN", "--algo", "ite"], "algo is 'ite': "),
        (["RUN", "--seed", "7"], "seed is 7: "),
        (["RUN", "--damage", "leg_rf"], "damage is 'leg_rf': RUN has policies for leg_rm, leg_lf"),
        (["--damage", "knee"], "unknown part 'knee'"),
        (["--seed", "0"], "seed is 0: an atlas has one policy for each damage"),
        (["--algo", "srl"], "algo is ('srl',): an atlas has one policy for each damage"),
        (["--out", "own.json"], "out is own.json: files of format npz end in .npz"),
        (["--format", "onnx", "--out", "own.onnx"], "an .onnx holds one policy, and there are 76"),
    ],
)
def test_bad_input_is_one_sentence(words, message, finished, asked, tmp_path):
    code, said = asked(*(finished if word == "RUN" else word for word in words))
    assert code == 2 and message.replace("RUN", str(finished)) in said.err and said.err.count("\n") == 1
    assert not list(tmp_path.glob("*.*"))
