"""Links between files of the repository lead somewhere, also those that the site does not show."""

import re

import pytest

from tests.docs.reading import DOCS, FENCE, PAGES, ROOT

LINK = re.compile(r"\]\(([^)\s]+)\)")
FILES = [*PAGES, ROOT / "CHANGELOG.md"]


def missing(page, text):
    """Links to files that are not there."""
    targets = [target.partition("#")[0] for target in LINK.findall(FENCE.sub("", text)) if "://" not in target]
    return [target for target in targets if target and not (page.parent / target).exists()]


@pytest.mark.parametrize("page", FILES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    assert missing(page, page.read_text()) == []


def test_a_link_that_leads_nowhere_is_found():
    text = "[a](index.md#start) [b](howto/robots.md) ![c](walking.webp) [d](https://nowhere) [e](#here)"
    assert missing(DOCS / "index.md", text) == ["howto/robots.md"]
