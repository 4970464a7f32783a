"""What the documentation says that a reader would type: its pages, their blocks of code, and every command in them.

An HTML comment before a block says how it is treated; the reader does not see it:

    <!-- first: ... -->      Python that runs before it
    <!-- slow: why -->       it runs with the tests that are marked slow (a block of commands only where it is marked)
    <!-- runs: what -->      a block of commands that is not only parsed but runs as well
    <!-- not run: why -->    a block of Python that is compiled at most
"""

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
HISTORY = {DOCS / "decisions.md"}  # commands as they were when something was decided
PAGES = sorted({ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")})
NOTEBOOK = DOCS / "tour.ipynb"
MARK = re.compile(r"<!--\s*(first|slow|runs|not run):(.*?)-->", re.DOTALL)
COMMENTS = re.compile(r"(?:<!--(?:(?!-->).)*-->\s*)+\Z", re.DOTALL)  # right before a block, one or several
FENCE = re.compile(r"^( *)```([\w-]*)[^\n]*\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
TYPED = ("", "bash", "console")  # languages of blocks that have commands
BEFORE = r"(?:\$ )?(?:taskset -c \S+ )?(?:\.venv/bin/)?"
STARTS = re.compile(BEFORE + r"(srl-jax|python -m (?:srl_jax|experiments)[.\w]*|make)(?= |$)")


class Block(NamedTuple):
    """One fenced block."""

    page: Path
    line: int  # of its first line of code, from 1
    language: str
    text: str
    marks: dict[str, str]  # of the comment before it: word -> what follows

    @property
    def name(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def python(self) -> bool:
        return self.language == "python" and "not run" not in self.marks

    @property
    def runs(self) -> bool:
        return self.python or (self.language in TYPED and bool({"runs", "slow"} & set(self.marks)))


class Command(NamedTuple):
    """One line that is typed into a terminal."""

    where: str
    words: tuple[str, ...]  # such as srl-jax, run, --seeds, 3


def blocks(page: Path, text: str | None = None) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text, found, last = page.read_text() if text is None else text, [], 0
    for match in FENCE.finditer(text):
        before = COMMENTS.search(text[last : match.start()])
        marks = {word: said.strip("\n ") for word, said in MARK.findall(before[0] if before else "")}
        code = re.sub(f"^{match[1]}", "", match[3], flags=re.MULTILINE)
        found.append(Block(page, text.count("\n", 0, match.start(3)) + 1, match[2], code, marks))
        last = match.end()
    return found


class Cell(NamedTuple):
    """A cell of code of the notebook."""

    code: str
    count: int | None  # when it was executed
    outputs: list[dict]


def cells(path: Path = NOTEBOOK) -> list[Cell]:
    """The code of a notebook, cell by cell."""
    own = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    return [Cell("".join(x["source"]), x["execution_count"], x["outputs"]) for x in own]


def commands(page: Path, text: str | None = None) -> Iterator[Command]:
    """Every command of a page, in its blocks and in its sentences."""
    text = page.read_text() if text is None else text
    name = str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name
    for block in blocks(page, text):
        if block.language in TYPED:
            for line in lines(block.text):
                if STARTS.match(line):
                    yield Command(name, words(line))
    for match in INLINE.finditer(FENCE.sub("", text)):
        line = " ".join(match[1].split())
        if STARTS.match(line):
            yield Command(name, words(line))


def lines(text: str) -> list[str]:
    """The lines of a block of commands; one that ends in a backslash goes on in the next."""
    return [line.strip() for line in text.replace("\\\n", " ").splitlines()]


def words(line: str) -> tuple[str, ...]:
    """A line as a shell splits it, from the program on, without what stands for more and what is optional."""
    found = shlex.split(re.sub(f"^{BEFORE}", "", line), comments=True)
    return tuple(word.strip("[]") for word in found if word != "...")
