"""A page holds all of a run in one well-formed file, whatever its methods and damages are called."""

import base64
import re

import numpy as np
import pytest

from srl_jax.report import inline
from srl_jax.report.films import caption
from srl_jax.report.page import render
from srl_jax.report.video import save_video
from tests.report import contents
from tests.report.html import Read
from tests.report.runs import DAMAGES, METHODS, SEEDS, failing

MANY = {("srl", ""): 0.3} | {("srl", f"beta={n / 20:g}"): 0.3 + n / 40 for n in range(13)}
LOCAL = re.compile(r"data:|#|$")


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A page on which a lane has failed, and how it reads."""
    page = render(contents.content(tmp_path_factory.mktemp("page"), edit=failing({5}, since=200)))
    return page, Read(page)


def test_it_is_one_file_that_needs_no_other(shown):
    page, read = shown
    assert page.startswith("<!DOCTYPE html>") and "viewport" in page
    assert read.references and all(LOCAL.match(reference) for reference in read.references)
    assert "http" not in page and "script" not in read.tags
    assert len(set(read.names)) == len(read.names)
    wanted = {reference[1:] for reference in read.references if reference.startswith("#")}
    assert wanted == set(read.names)


def test_it_names_every_method_and_what_failed(shown):
    text = shown[1].text
    for name in ("DDPG", "SRL", "SRL dropout=0.03", *DAMAGES, "legs", contents.COMMAND):
        assert name in text
    assert "1 of 36 lanes met a number that is not finite" in text
    assert "5 ddpg leg 2 4 200 eval" in text


def test_it_says_what_was_asked_and_what_it_took(shown):
    text = shown[1].text
    assert "Seeds 3 to 6" in text and "Steps of a lane 300, 15 s of robot time" in text
    assert "2 settings other than in preset smoke" in text and "srl.commit off on" in text
    for fact in ("Training 1.5 min", "Compiling 30 s", "Environment steps 6,504 / s", "jax 0.10.2", "10:00:00 UTC"):
        assert fact in text
    assert "Peak memory" not in text, "the system did not say"


def test_curves_are_drawn_for_both_screens(shown):
    page = shown[0]
    drawn = re.findall(r'<svg role="img".*?</svg>', page)
    assert len(drawn) == 2 + len(DAMAGES)
    assert all(f"<figcaption>{damage}</figcaption>" in page for damage in DAMAGES)
    assert ">success rate<" in drawn[0] and ">200<" in drawn[3], "text stays text"
    used = set(re.findall(r"var\((--ink-\w+)\)", page))
    assert {"--ink-0072b2", "--ink-222222"} <= used
    for colour in used:
        assert len(re.findall(rf"{colour}: #", page)) == 2, "for light, and for dark"
    assert not re.findall(r"#[0-9a-f]{6}", "".join(drawn)), "no colour is of one screen only"


def test_numbers_are_those_of_the_summary(tmp_path):
    content = contents.content(tmp_path)
    text = Read(render(content)).text
    found = content.summary["methods"]["srl"]["overall"]["success"]
    cell = f"{found['iqm']:.2f} [{found['low']:.2f}, {found['high']:.2f}]".replace("0.", ".")
    assert f"SRL reaches the goal in {cell} of its episodes" in text and text.count(cell) >= 2
    pair = next(x for x in content.summary["improvement"] if (x["x"], x["y"]) == ("srl", "ddpg"))
    assert pair["probability"] == 1.0 and "than DDPG than SRL" in text


def test_names_are_text_and_never_markup(tmp_path):
    odd = "<b>&amp;\"x'</b><script>alert(1)</script>"
    content = contents.content(tmp_path, name=odd, damages=("leg 0", odd), methods={("srl", f"v={odd}"): 0.5})
    read = Read(render(content))
    assert "script" not in read.tags and "b" not in read.tags
    assert read.text.count(odd) >= 4, "run, method, caption and damage"


def test_what_is_not_finished_says_so(tmp_path):
    text = Read(render(contents.content(tmp_path, finished=False))).text
    assert "This run is not finished: these are its first 300 of 300 steps." in text


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda rows: [row for row in rows if row[2].startswith("healthy/")], "Nothing has been evaluated yet."),
        (lambda rows: [row for row in rows if row[2] == "eval/return"], "SRL returns "),
    ],
)
def test_a_run_that_lacks_metrics_has_a_page(tmp_path, edit, said):
    assert said in Read(render(contents.content(tmp_path, edit=edit))).text


def test_a_summary_of_another_version_has_a_page(tmp_path):
    older = {"improvement": None, "nonfinite_lanes": None, "reference": None}
    content = contents.content(tmp_path, changes=older)
    bare = content._replace(sources=[content.sources[0]._replace(machine={}, parts=[], asked=[])])
    text = Read(render(bare)).text
    assert "SRL reaches the goal" in text and "Better by" not in text and "Training" not in text


def test_many_methods_are_compared_with_the_first(tmp_path):
    text = Read(render(contents.content(tmp_path, methods=MANY, seeds=SEEDS[:1]))).text
    assert "only pairs with the first, 'srl', were compared" in text
    assert "than SRL" in text and "than SRL beta" not in text
    assert "Grey: 6 that end lower." in text and "Of 14 methods SRL beta=0.6 reaches" in text


def test_runs_stand_side_by_side(tmp_path):
    content = contents.content(tmp_path)
    (one,) = content.sources
    text = Read(render(content._replace(sources=[one, one._replace(name="arms")]))).text
    assert "legs and arms" in text and text.count(contents.COMMAND) == 2


def test_videos_are_inside(tmp_path):
    frames = np.random.default_rng(0).integers(0, 255, (3, 48, 64, 3), dtype=np.uint8)
    film = tmp_path / "srl-leg-0-seed3.mp4"
    save_video(film, frames)
    page = render(contents.content(tmp_path / "run", videos=[film]))
    kinds = dict(reference[5:].split(";base64,") for reference in Read(page).references if reference[:5] == "data:")
    assert base64.b64decode(kinds["video/mp4"]) == film.read_bytes()
    assert base64.b64decode(kinds["image/jpeg"])[:3] == b"\xff\xd8\xff"
    assert len(page) <= 1.37 * film.stat().st_size + 1.5e6


def test_a_video_is_called_what_it_shows(tmp_path):
    groups = list(contents.content(tmp_path, methods=METHODS | {("srl", "beta=1 tau=0.1"): 0.5}).run.groups)
    assert caption("srl-beta=1-tau=0.1-coxa_rf-limp+leg_lf-seed12", groups) == (
        "SRL beta=1 tau=0.1, coxa_rf:limp+leg_lf, seed 12"
    )
    assert caption("srl-leg_rm-seed0", groups) == "SRL, leg_rm, seed 0"
    assert caption("something-else", groups) == "something-else"


def test_the_same_run_gives_the_same_page(tmp_path):
    content = contents.content(tmp_path)
    assert render(content) == render(content)


def test_every_look_has_a_key(tmp_path):
    looks = inline.draw(contents.content(tmp_path, methods=MANY, seeds=SEEDS[:1]).run).looks
    keys = {inline.key(look) for look in looks.values()}
    assert len(keys) == 8 + 1, "those with names, and grey"
    assert all("var(--ink-" in key for key in keys)
