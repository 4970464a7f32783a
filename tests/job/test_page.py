"""Runs, finished or not, in waves, or several side by side, become a page; a page that fails undoes nothing."""

import html
import json
import re
import shlex
from types import SimpleNamespace

import pytest

from srl_jax.cli import run as verb
from srl_jax.config import preset
from srl_jax.job import files, page
from srl_jax.job import run as jobs
from srl_jax.report.page import render
from tests.report.html import Read
from tests.report.runs import write

DDPG, SRL = {("ddpg", ""): 0.2}, {("srl", ""): 0.6}


def finished(directory, **written):
    """A run that never ran, but says that it is done."""
    write(directory, **written)
    content = page.of_run(directory)
    (directory / "summary.json").write_text(json.dumps(content.summary))
    return directory


def test_a_run_leaves_a_page_that_gives_it_again(smoke_run):
    directory = smoke_run[0]
    text = (directory / "report.html").read_text()
    read = Read(text)
    assert "not finished" not in read.text and all(f"seed {n}" not in read.text for n in (2, 3))
    (command,) = re.findall(r"<pre><code>(.*?)</code></pre>", text)
    assert verb.parse(shlex.split(html.unescape(command))[2:])[1] == files.read_config(directory)[0] == preset("smoke")
    films = list((directory / "videos").iterdir())
    assert len(films) == read.tags.count("video") == 2
    assert len(text) <= 1.37 * sum(film.stat().st_size for film in films) + 1.5e6


def test_it_can_be_made_anew_as_it_was(smoke_run):
    assert render(page.of_run(smoke_run[0])) == (smoke_run[0] / "report.html").read_text()


def test_a_run_that_goes_on_is_shown_as_far_as_it_is(tmp_path):
    cut = lambda rows: [row for row in rows if row[0] < 300 or row[1] < 3]  # noqa: E731  half an evaluation
    content = page.of_run(write(tmp_path / "run", edit=cut))
    assert not content.finished and content.summary["steps"] == 300
    assert "This run is not finished" in Read(render(content)).text


def test_waves_that_are_done_are_shown_while_others_go_on(tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    finished(run / "wave-1", methods=SRL)
    write(run / "wave-2", methods=DDPG, first=12)
    for name in ("config.json", "lanes.csv"):
        (run / name).write_text((run / "wave-1" / name).read_text())
    content = page.of_run(run)
    assert list(content.summary["methods"]) == ["srl"] and not content.finished
    assert content.notes == ["Lanes are trained in waves; of wave-1 there are numbers."]
    (run / "wave-1" / "summary.json").unlink()
    assert len(page.of_run(run).run.lanes) == 12, "of the one under way where none is done"


def test_lanes_that_fill_no_table_are_named(tmp_path):
    run = finished(tmp_path / "run", methods=SRL)
    rows = (run / "lanes.csv").read_text().splitlines(keepends=True)
    (run / "lanes.csv").write_text("".join(rows[:-1]))
    content = page.of_run(run)
    assert content.notes == ["srl: 9 of the 11 lanes that there are fill a table."]


def test_runs_that_are_comparable_share_a_page(tmp_path):
    runs = [finished(tmp_path / "one", methods=DDPG), finished(tmp_path / "two", methods=SRL)]
    content = page.of_runs(runs)
    assert list(content.summary["methods"]) == ["ddpg", "srl"] and content.summary["improvement"]
    assert [source.name for source in content.sources] == ["one", "two"]
    assert "one and two" in Read(render(content)).text
    (tmp_path / "other").mkdir()
    again = finished(tmp_path / "other" / "one", methods={("srl", "beta=1"): 0.6})
    assert [source.name for source in page.of_runs([runs[0], again]).sources] == [str(runs[0]), str(again)]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"methods": SRL, "task": "x"}, "differs from .* in task: no fair table"),
        ({"methods": DDPG}, "both have the lane ddpg 3 p2p leg 0"),
    ],
)
def test_runs_that_are_not_comparable_are_refused(tmp_path, other, message):
    one = finished(tmp_path / "one", methods=DDPG)
    with pytest.raises(ValueError, match=message):
        page.of_runs([one, finished(tmp_path / "other", **other)])


def test_an_unfinished_run_stands_beside_no_other(tmp_path):
    one, other = finished(tmp_path / "one", methods=DDPG), write(tmp_path / "other", methods=SRL)
    with pytest.raises(ValueError, match=r"other has no summary\.json: it is not finished"):
        page.of_runs([one, other])


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(ValueError, match="is not the directory of a run"):
        page.of_run(tmp_path)


def test_a_page_that_fails_leaves_the_old_one_and_a_sentence(tmp_path, monkeypatch):
    run = finished(tmp_path / "run", methods=SRL)
    assert page.leave(run) == ""
    before = (run / "report.html").read_text()

    def broken(content):
        raise RuntimeError("no fonts")

    monkeypatch.setattr(page, "render", broken)
    assert page.leave(run) == "report.html could not be made: no fonts"
    assert (run / "report.html").read_text() == before


def test_a_page_that_fails_does_not_fail_its_run(tmp_path, monkeypatch):
    trained = SimpleNamespace(go=lambda: {"machine": {}})  # and no file that a page could be made of
    monkeypatch.setattr(jobs, "Loop", lambda *_: trained)
    notes = []
    summary = jobs.run(preset("smoke"), tmp_path / "run", 1, listener=lambda status: notes.append(status.note))
    assert summary == {"machine": {}} and notes[-1].startswith("report.html could not be made: ")
