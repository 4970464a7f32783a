"""The one command: its verbs at a glance, each verb's options, and what is no verb."""

import importlib
import subprocess
import sys

import pytest

from srl_jax.cli import main as cli


def answer(capsys, *arguments):
    """Exit code and output of the command."""
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    return caught.value.code, *capsys.readouterr()


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], []])
def test_every_verb_is_listed_with_a_sentence(arguments, capsys):
    code, printed, _ = answer(capsys, *arguments)
    assert code == 0
    for name, (sentence, _) in cli.VERBS.items():
        assert any(line.split(maxsplit=1) == [name, sentence] for line in printed.splitlines())


def test_every_verb_can_be_imported():
    for _, target in cli.VERBS.values():
        module, function = target.split(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_the_list_needs_nothing_but_the_standard_library():
    code = """
import sys
from srl_jax.cli import main
try:
    main.main(["--help"])
except SystemExit:
    sys.exit(bool({"jax", "numpy", "tyro", "rich"} & set(sys.modules)))
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_verb_is_handed_the_other_arguments(capsys, monkeypatch):
    monkeypatch.setitem(cli.VERBS, "echo", ("says it again", "builtins:print"))
    assert answer(capsys, "echo", "--seeds", "3") == (0, "['--seeds', '3']\n", "")


@pytest.mark.parametrize("verb", ["rnu", "--seeds", ""])
def test_what_is_no_verb_is_one_sentence(verb, capsys):
    code, printed, said = answer(capsys, verb, "--help")
    assert (code, printed) == (2, "")
    assert said == f"srl_jax: srl-jax has no verb {verb!r}: choose from {', '.join(cli.VERBS)}.\n"


DOORS = {
    "-m srl_jax": "usage: srl-jax VERB",
    "-m srl_jax run": "usage: srl-jax run",
    "-m srl_jax.run": "usage: srl-jax run",
    "-m srl_jax.repertoire": "usage: srl-jax repertoire",
    "-m srl_jax.report": "usage: srl-jax report",
}


@pytest.mark.parametrize("door", DOORS)
def test_doors(door):
    command = [sys.executable, *door.split(), "--help"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed.startswith(DOORS[door])
