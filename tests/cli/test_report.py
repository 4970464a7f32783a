"""The verb report: a page of one run or of several, its table, and what is refused."""

import json

import pytest

from srl_jax.cli import report
from srl_jax.job import page
from tests.report.runs import write

METHODS = {("ddpg", ""): 0.2, ("srl", ""): 0.6}


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Two finished runs of a method each, and one of another task, by relative names."""
    monkeypatch.chdir(tmp_path)
    for name, written in {
        **{algo: {"methods": {(algo, ""): height}} for (algo, _), height in METHODS.items()},
        "x": {"task": "x", "methods": {("mcpg", ""): 0.3}},
    }.items():
        write(tmp_path / name, **written)
        (tmp_path / name / "summary.json").write_text(json.dumps(page.of_run(tmp_path / name).summary))
    return tmp_path


def asked(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        report.main(list(words))
    return ended.value.code, *capsys.readouterr()


def test_a_run_gets_its_page(runs, capsys):
    code, printed, _ = asked(capsys, "srl")
    assert code == 0 and "Open it in a browser" in printed and "SRL" in (runs / "srl" / "report.html").read_text()
    assert not (runs / "report.html").exists()


def test_several_are_one_table_and_one_figure(runs, capsys):
    code, printed, _ = asked(capsys, "ddpg", "srl", "--curves", "joint.png")
    assert code == 0
    assert "P(ddpg > srl) in area_success: .00 [.00, .00]" in printed
    assert "P(srl > ddpg) in area_return: 1.00 [1.00, 1.00]" in printed
    assert "<h1>ddpg and srl</h1>" in (runs / "report.html").read_text()
    assert (runs / "joint.png").stat().st_size > 10_000


def test_the_page_goes_where_it_is_told(runs, capsys):
    assert asked(capsys, "srl", "--out", "pages/one.html")[0] == 0
    assert (runs / "pages" / "one.html").exists() and not (runs / "srl" / "report.html").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no run is given"),
        (["nowhere"], "nowhere is not the directory of a run"),
        (["ddpg", "ddpg"], "both have the lane ddpg"),
        (["ddpg", "x"], "x differs from ddpg in task: no fair table"),
        (["ddpg", "--out", "."], "out is ., a directory: give the file"),
    ],
)
def test_bad_input_is_one_sentence(words, message, runs, capsys):
    code, _, said = asked(capsys, *words)
    assert code == 2 and message in said and said.count("\n") == 1
    assert not (runs / "report.html").exists() and not (runs / "ddpg" / "report.html").exists()
