"""The verb demo: from runs and atlases to a page, and what is refused."""

import pytest

from srl_jax.cli import demo
from tests.demo import pages

verb = demo


def test_an_atlas_and_a_run_on_one_page(finished, asked, tmp_path):
    code, said = asked(finished, "", "--damages", "leg_rm,leg_rf+leg_lr", "--out", tmp_path / "a.html")
    assert code == 0 and "Open it in a browser" in said.out
    carried = pages.read(tmp_path / "a.html")
    run, atlas = carried["sources"]
    assert [method["name"] for method in run["methods"]] == ["pi_B", "ddpg", "srl"] and run["task"] == "p2p"
    assert set(run["sets"]["srl"]) == {"leg_rm", "leg_lf"} and "gait" in run["sets"]["pi_B"]["healthy"]
    assert set(atlas["sets"]["atlas"]) == set(carried["atlas"]["damages"]) == {"healthy", "leg_rm", "leg_rf+leg_lr"}
    assert {"leg_lf", "leg_rf+leg_lr"} <= set(carried["damages"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.npz"], "nowhere.npz does not exist"),
        (["", ""], "sources has two atlases"),
        (["--damages", "leg_rf+leg_rm+leg_rr"], "the atlas has policies for healthy, "),
        (["--out", "."], "a directory: give the file"),
        (["RUN", "--seed", "7"], "seed is 7"),
    ],
)
def test_bad_input_is_one_sentence(words, message, finished, asked, tmp_path):
    code, said = asked(*(finished if word == "RUN" else word for word in words))
    assert code == 2 and message in said.err and said.err.count("\n") == 1
    assert not (tmp_path / "demo.html").exists()
