"""Whether a command of the documentation would be understood, by the parser of its own verb; nothing is done."""

import importlib
import re
import tomllib

import tyro

from srl_jax import config
from srl_jax.cli import main, run, sweep
from srl_jax.cli.grid import combinations
from srl_jax.job import plan
from tests.docs.reading import ROOT

MAKEFILE = (ROOT / "Makefile").read_text()
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])


class Understood(BaseException):
    """Thrown where a command has been parsed, so that nothing else happens."""


def check(words, monkeypatch):
    """Raises SystemExit, ValueError or AssertionError where a command would not be understood."""
    program, rest = words[0], list(words[1:])
    if program == "make":
        made(rest)
        return
    if program == "python":
        module, rest = rest[1], rest[2:]
        if module.startswith("experiments"):
            experiment(module, rest)
            return
        rest = [module.removeprefix("srl_jax").lstrip("."), *rest]
        rest = rest if rest[0] else rest[1:]
    rest = [word for word in rest if word != "--help"]
    if not rest:
        return
    verb, asked = rest[0], rest[1:]
    assert verb in main.VERBS, f"srl-jax has no verb {verb}"
    if asked:
        verbs(verb, asked, monkeypatch)


def verbs(verb, asked, monkeypatch):
    """The parser of a verb of srl-jax; of a run its lanes as well."""
    real = tyro.cli

    def parsed(*arguments, **options):
        raise Understood(real(*arguments, **options))

    monkeypatch.setattr(run, "read_config", lambda _: (config.preset("default"), 1))  # of the run that is gone on with
    if verb == "run":
        lanes(asked)
    elif verb == "sweep":
        found, rest = sweep.parse(asked if "--out" in asked else ["--out", "sweep", *asked])
        for _, arguments in combinations(found.grid, rest):
            lanes(arguments)
    else:
        module, function = main.VERBS[verb][1].split(":")
        monkeypatch.setattr(tyro, "cli", parsed)
        try:
            getattr(importlib.import_module(module), function)(asked)
        except Understood:
            return
        finally:
            monkeypatch.setattr(tyro, "cli", real)
        raise AssertionError(f"{verb} did not parse its arguments")


def lanes(asked):
    """A run's words, down to algorithms, damages and teachers."""
    configured = run.parse(list(asked))[1]
    plan.make(configured)
    plan.parse_teachers(configured)


def experiment(module, asked):
    """An experiment's own parser."""
    own = importlib.import_module(module)
    parser = getattr(own, "Args", None) or getattr(own, "Arguments", None) or own.main
    if asked and parser is own.main:
        real = own.main
        assert callable(real)
        options = {name.replace("_", "-") for name in real.__code__.co_varnames[: real.__code__.co_argcount]}
        unknown = {word[2:].partition("=")[0] for word in asked if word.startswith("--")} - options
        assert not unknown, f"{module} has no options {unknown}"
    elif asked:
        tyro.cli(parser, args=asked)


def made(asked):
    """A target of the Makefile; what ARGS hands on to a run is a run's."""
    targets = [word for word in asked if "=" not in word]
    assert set(targets) <= TARGETS, f"make has no target {' '.join(targets)}"
    arguments = [word.removeprefix("ARGS=").split() for word in asked if word.startswith("ARGS=")]
    if targets == ["run"]:
        for own in arguments:
            lanes(["--seeds", "10", "--task", "p2p", *own])
    for word in (word for own in arguments for word in own if word.startswith("tests/")):
        assert (ROOT / word).exists(), f"there is no {word}"
