"""A page in a real browser: a phone shows all of it, it is dark where the screen is, and paper cuts no figure."""

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from srl_jax.report.page import render
from srl_jax.report.video import save_video
from tests.browsing import _browser, needs_chromium, watched  # noqa: F401  a fixture
from tests.report import contents
from tests.report.runs import METHODS

LONG = {("srl", "critic_lr=0.0003 guidance_weight=4 hidden=256,256 dropout=0.1"): 0.5}
pytestmark = needs_chromium


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A page with long names, a video and a lane that failed."""
    folder = tmp_path_factory.mktemp("page")
    save_video(folder / "srl-leg_rm-seed0.mp4", np.full((3, 48, 64, 3), 90, np.uint8))
    damages = tuple(f"coxa_{n}:limp+femur_{n}:locked+leg_{n}" for n in range(14))
    content = contents.content(
        folder / "run",
        name="a-run-with-a-name-that-is-far-too-long-for-a-phone-20261128",
        methods=METHODS | LONG,
        damages=damages,
        videos=[folder / "srl-leg_rm-seed0.mp4"],
    )
    (folder / "report.html").write_text(render(content))
    return folder / "report.html"


@pytest.fixture
def opened(browser, written):
    """(width, scheme) -> the page."""
    with ExitStack() as opening:

        def open_(width, scheme="light"):
            page = opening.enter_context(
                watched(browser, viewport={"width": width, "height": 800}, color_scheme=scheme)
            )
            page.goto(written.as_uri())
            return page

        yield open_


@pytest.mark.parametrize("width", [390, 1200])
def test_nothing_hangs_over_the_edge(opened, width, tmp_path):
    page = opened(width)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    wide = "[...document.querySelectorAll('.scroll')].filter((box) => box.scrollWidth > box.clientWidth).length"
    assert (page.evaluate(wide) > 0) == (width == 390), "what is too wide scrolls in its box"
    page.screenshot(path=Path(os.environ.get("SRL_JAX_SCREENSHOTS", tmp_path)) / f"page-{width}.png", full_page=True)


@pytest.mark.parametrize(("scheme", "paper", "ink"), [("light", 255, "#0072b2"), ("dark", 20, "#4ba6e0")])
def test_it_is_dark_where_the_screen_is(opened, scheme, paper, ink):
    page = opened(1200, scheme)
    colour = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert colour.startswith(f"rgb({paper},")
    red, green, blue = (int(ink[n : n + 2], 16) for n in (1, 3, 5))
    curve = "getComputedStyle(document.querySelector('.large path[style*=\"--ink-0072b2\"]')).stroke"
    assert page.evaluate(curve) == f"rgb({red}, {green}, {blue})"


def test_on_paper_it_is_light_and_no_figure_is_cut(opened, tmp_path):
    page = opened(1200, "dark")
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    kept = (
        "[...document.querySelectorAll('.large svg, .small figure, .film')].map((x) => getComputedStyle(x).breakInside)"
    )
    assert set(page.evaluate(kept)) == {"avoid"}
    assert page.pdf(format="A4").startswith(b"%PDF")
