"""What stands on the page of a run, as data: its numbers, what was asked, and how it went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from srl_jax.report.data import RunData


class Change(NamedTuple):
    """A setting that is not the preset's."""

    name: str  # with its section, such as srl.dropout
    value: Any  # as JSON
    default: Any  # the preset's; None where it has no such setting


class Asked(NamedTuple):
    """What a run was told."""

    label: str  # of a sweep's point, empty where there is one only
    preset: str
    changes: Sequence[Change]
    command: str  # that gives the run again; empty where its settings are those of another version


class Source(NamedTuple):
    """One run on a page."""

    name: str
    asked: Sequence[Asked]  # one, or one for every point of a sweep
    parts: Sequence[Mapping[str, Any]]  # of config.json: every process that worked on it
    machine: Mapping[str, Any]  # of summary.json, empty while the run is unfinished
    videos: Sequence[Path]


class Content(NamedTuple):
    """All of a page."""

    run: RunData  # lanes that fill seeds x damages
    summary: Mapping[str, Any]
    sources: Sequence[Source]  # several where runs were joined
    finished: bool
    notes: Sequence[str] = ()  # sentences on what is missing
