"""Every block of Python in the documentation runs, in one namespace for a page; commands do where they are marked."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from srl_jax.agents import registry
from tests.docs.reading import PAGES, ROOT, Block, blocks, lines

RUN = {page: [block for block in blocks(page) if block.runs] for page in PAGES}
SLOW = {page for page, own in RUN.items() if any("slow" in block.marks for block in own)}
QUICK = {page for page, own in RUN.items() if any("slow" not in block.marks for block in own)}
LEFT_OUT = 3  # blocks of Python that may be left unrun, each with its reason


@pytest.fixture
def follow(tmp_path, monkeypatch):
    """(blocks) -> runs them as a reader would, in an empty folder; algorithms that they register are forgotten."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_algorithms", dict(registry._algorithms))
    monkeypatch.setattr(registry, "_makers", dict(registry._makers))
    page = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", page)

    def go(own):
        for block in own:
            if block.language == "python":
                exec(block.marks.get("first", ""), page.__dict__)
                # As many lines before it as in its page, so that a traceback names the page's own line.
                exec(compile("\n" * (block.line - 1) + block.text, str(block.page), "exec"), page.__dict__)
            else:
                shell(block)

    return go


def shell(block):
    """Runs a block of commands, by this Python and this checkout."""
    paths = {"PYTHONPATH": str(ROOT), "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    for line in filter(None, lines(block.text)):
        words = line.replace("srl-jax ", f"{sys.executable} -m srl_jax ", 1)
        done = subprocess.run(words, shell=True, env=os.environ | paths, capture_output=True, text=True)
        assert done.returncode == 0, f"{block.name}: {line}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"


def named(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", sorted(QUICK), ids=named)
def test_blocks_run(page, follow):
    follow([block for block in RUN[page] if "slow" not in block.marks])


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(SLOW), ids=named)
def test_blocks_run_that_take_longer(page, follow):
    follow(RUN[page])


def test_few_blocks_are_left_out():
    python = [block for page in PAGES for block in blocks(page) if block.language == "python"]
    left = {block.name: block.marks["not run"] for block in python if not block.runs}
    assert len(python) > 15 and len(left) <= LEFT_OUT and all(left.values()), left
    for block in python:
        compile(block.text, block.name, "exec")


# The reader on small pages.


def page_of(tmp_path, text):
    path = tmp_path / "page.md"
    path.write_text(text)
    return [block for block in blocks(path) if block.runs]


def test_a_block_that_fails_is_found_at_its_line(tmp_path, follow):
    own = page_of(tmp_path, "# Page\n\n```python\nx = 1\n```\n\nAnd:\n\n```python\nassert x == 1\nassert x == 2\n```\n")
    with pytest.raises(AssertionError) as caught:
        follow(own)
    assert caught.traceback[-1].lineno + 1 == 11


def test_marks(tmp_path, follow):
    text = "<!-- first:\ny = 3\n-->\n```python\nassert y == 3\n```\n\n<!-- not run: why -->\n```python\nboom()\n```\n"
    own = page_of(tmp_path, text + "\n```bash\nfalse\n```\n\n<!-- runs: cheap -->\n```bash\necho a > b\n```\n")
    assert [block.language for block in own] == ["python", "bash"]
    follow(own)
    assert Path("b").read_text() == "a\n"


def test_a_command_that_fails_is_found(tmp_path, follow):
    with pytest.raises(AssertionError, match="no verb"):
        follow([Block(ROOT / "page.md", 1, "bash", "srl-jax walk\n", {"runs": ""})])
