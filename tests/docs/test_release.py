"""What a release names in several places is the same in all, and the image is built as the README says."""

import re
import shlex
import tomllib

import yaml

import srl_jax
from tests.docs.reading import ROOT, blocks

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
INSTALLS_MAKE = "apt-get"  # what python:3.11-slim lacks of what the README asks for


def build_lines(dockerfile):
    """The commands by which an image is built, without those that bring make or clear caches."""
    text = dockerfile.replace("\\\n", " ")
    own = [part.strip() for line in re.findall(r"^RUN (.*)$", text, re.MULTILINE) for part in line.split("&&")]
    return [line for line in own if not line.startswith((INSTALLS_MAKE, "rm -rf"))]


def typed(page):
    """The commands of a page's blocks, without comments."""
    lines = [line for block in blocks(page) if block.language == "" for line in block.text.splitlines()]
    return [shlex.join(shlex.split(line, comments=True)) for line in lines]


def test_the_image_is_built_by_lines_of_the_readme():
    lines, readme = build_lines((ROOT / "Dockerfile").read_text()), ROOT / "README.md"
    assert lines and set(lines) <= set(typed(readme))
    assert "python:3.11" in (ROOT / "Dockerfile").read_text() and "Python 3.11 or newer" in readme.read_text()


def test_another_build_line_is_found():
    text = "FROM x\nRUN apt-get update \\\n    && rm -rf /var\nRUN make install && pip install more\n"
    assert build_lines(text) == ["make install", "pip install more"]


def test_the_version_is_one():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert PROJECT["version"] == srl_jax.__version__ == str(citation["version"])
    assert PROJECT["license"] == citation["license"]


def test_the_citation_is_whole():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert set(citation) >= {"cff-version", "message", "title", "authors", "type"}
    assert citation["cff-version"] == "1.2.0" and citation["type"] == "software"
    for work in (citation, *citation["references"]):
        assert all({"name"} <= set(who) or {"family-names", "given-names"} <= set(who) for who in work["authors"])
