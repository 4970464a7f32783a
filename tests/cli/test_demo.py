"""The verb demo: from runs and atlases to a page, and what is refused."""

import dataclasses

import pytest

from srl_jax.cli import demo
from srl_jax.config import preset
from srl_jax.demo import page
from tests.job.untrained import write


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    directory = tmp_path_factory.mktemp("demo") / "run"
    write(dataclasses.replace(preset("smoke"), damage="leg_rm,leg_lf", algos="ddpg,srl"), directory)
    return directory


def asked(words, capsys):
    with pytest.raises(SystemExit) as ended:
        demo.main([str(word) for word in words])
    return ended.value.code, capsys.readouterr()


def test_an_atlas_and_a_run_on_one_page(finished, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "use_devices", lambda *_, **__: 1)  # jax has started
    code, said = asked([finished, "", "--damages", "leg_rm,leg_rf+leg_lr", "--out", tmp_path / "a.html"], capsys)
    assert code == 0 and "Open it in a browser" in said.out
    carried = page.read(tmp_path / "a.html")
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
def test_bad_input_is_one_sentence(words, message, finished, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "use_devices", lambda *_, **__: 1)
    monkeypatch.chdir(tmp_path)
    code, said = asked([finished if word == "RUN" else word for word in words], capsys)
    assert code == 2 and message in said.err and said.err.count("\n") == 1
    assert not (tmp_path / "demo.html").exists()
