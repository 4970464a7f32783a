"""Every command of the documentation is understood by the real parsers: an option that is gone is found here."""

from pathlib import Path

import pytest

from tests.docs import asking
from tests.docs.reading import HISTORY, PAGES, ROOT, commands

ALL = {page: list(commands(page)) for page in PAGES if page not in HISTORY}
PAGE = Path("page.md")


def refused(found, monkeypatch, capsys):
    """A sentence for each command that would not be understood."""
    wrong = []
    for where, words in dict.fromkeys(found):
        try:
            asking.check(words, monkeypatch)
        except (SystemExit, ValueError, AssertionError, ImportError) as error:
            said = " ".join(capsys.readouterr().err.split())[-300:]
            wrong.append(f"{where}: {' '.join(words)}: {error} {said}")
    return wrong


@pytest.mark.parametrize("page", [page for page in ALL if ALL[page]], ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_understood(page, monkeypatch, capsys):
    assert refused(ALL[page], monkeypatch, capsys) == []


def test_commands_are_found():
    assert sum(map(len, ALL.values())) > 120
    assert {words[1] for own in ALL.values() for _, words in own if words[0] == "srl-jax" and len(words) > 1} >= {
        "run", "sweep", "recover", "play", "export", "report", "demo",
    }  # fmt: skip


def test_extras_of_installations_exist():
    for page in ALL:
        for extras in asking.re.findall(r"(?:srl-jax|'\.)\[([\w,]+)\]", page.read_text()):
            assert set(extras.split(",")) <= asking.EXTRAS, f"{page.name} installs [{extras}]"


# Each rule on a small page that breaks it.

WRONG = {
    "an option": "```bash\nsrl-jax run --seed 3\n```\n",
    "a sentence": "Ask `srl-jax play --damaged leg_rm` then.\n",
    "a line that goes on": "```\nsrl-jax recover \\\n    --no-such\n```\n",
    "a verb": "```console\n$ srl-jax walk --damage leg_rm\n```\n",
    "a damage": "`python -m srl_jax.run --damage leg_xx`\n",
    "a choice": "`python -m srl_jax.export --format\nyaml`\n",
    "an algorithm": "```\nsrl-jax sweep --algos sarsa --out here\n```\n",
    "a setting of a grid": "`srl-jax sweep --grid srl.hiden=64;128 --out here`\n",
    "an experiment": "`python -m experiments.lqr --repetition 3`\n",
    "an experiment by its function": "`python -m experiments.pendulum --seed 3`\n",
    "a target": "```\nmake tests\n```\n",
    "a run of make": '```\nmake run ARGS="--damage nothing"\n```\n',
}


@pytest.mark.parametrize("text", WRONG.values(), ids=WRONG)
def test_what_would_not_be_understood_is_found(text, monkeypatch, capsys):
    found = list(commands(PAGE, text))
    assert len(found) == 1
    assert len(refused(found, monkeypatch, capsys)) == 1
