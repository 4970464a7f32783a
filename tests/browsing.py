"""A real browser for pages that must work offline: what goes wrong on one fails the test."""

import shutil
from contextlib import contextmanager

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="pip install 'srl-jax[web]' brings playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox", "--disable-background-networking"]
LOCAL = ("file:", "data:", "blob:")
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium is installed (Debian: apt-get install chromium)"
)


@pytest.fixture(scope="module", name="browser")
def _browser():
    """Chromium, drawing without a GPU."""
    with sync_api.sync_playwright() as play:
        running = play.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield running
        running.close()


@contextmanager
def watched(browser, **options):
    """A new page; a console error, an exception or a request to elsewhere fails the test when it is closed."""
    errors, page = [], browser.new_page(**options)
    page.set_default_timeout(120_000)  # drawing without a GPU takes its time on a busy machine
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("request", lambda asked: errors.append(asked.url) if not asked.url.startswith(LOCAL) else None)
    yield page
    page.close()
    assert errors == []
