"""The part of a page that says where its numbers come from: settings, commands, machines and versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from srl_jax.report.content import Asked, Content, Source
from srl_jax.report.markup import Html, element, facts, folded, joined, section, table
from srl_jax.report.sentences import counted, spent

PARTS = 20  # processes of a run, or points of a sweep, that are listed


def provenance(content: Content) -> Html:
    """What was asked and on which machines, run by run."""
    several = len(content.sources) > 1
    own = [(source, element("h3", source.name) if several else "") for source in content.sources]
    asked = joined(joined([title, *map(_asked, source.asked[:PARTS])]) for source, title in own)
    left = sum(max(0, len(source.asked) - PARTS) for source in content.sources)
    more = element("p", f"and {left} more points; sweep.json has them all.", class_="note") if left else ""
    machines = joined(joined([title, _machine(source)]) for source, title in own)
    note = "The command trains the same lanes again; the settings are those that differ from the preset's."
    return joined([section("Again", asked, more, note=note), section("Machine", machines)])


def _asked(asked: Asked) -> Html:
    rows = [[change.name, value(change.value), value(change.default)] for change in asked.changes]
    settings = table(["setting", "here", f"in {asked.preset}"], rows) if rows else ""
    told = f"{counted(len(rows), 'setting')} other than in preset {asked.preset}"
    missing = "Its settings are those of another version, to which no command of this one leads."
    return joined(
        [
            element("p", asked.label, class_="note") if asked.label else "",
            element("pre", element("code", asked.command)) if asked.command else element("p", missing, class_="note"),
            folded(told, settings, shown=len(rows) <= PARTS) if rows else "",
        ]
    )


def _machine(source: Source) -> Html:
    machine = source.machine
    rates = [
        (name, f"{machine[key]:,} / s" if key in machine else "")
        for name, key in (
            ("Environment steps", "environment_steps_per_second"),
            ("Physics steps", "physics_steps_per_second"),
            ("Updates", "updates_per_second"),
        )
    ]
    times = [
        (name, spent(machine[key]) if key in machine else "")
        for name, key in (("Training", "training_seconds"), ("Compiling", "compile_seconds"))
    ]
    peak = machine.get("peak_memory_gib")
    counts = [(name.capitalize(), machine.get(name, "")) for name in ("devices", "lanes", "waves")]
    return joined(
        [facts([*times, *rates, ("Peak memory", "" if peak is None else f"{peak} GiB"), *counts]), _parts(source)]
    )


def _parts(source: Source) -> Html:
    """The processes that worked on a run, and the versions they had."""
    if not source.parts:
        return Html()
    columns = {
        "began": "began",
        "from_step": "from step",
        "devices": "devices",
        "machine": "machine",
        "python": "Python",
    }
    shown = [{**part, "began": _clock(part.get("began", ""))} for part in source.parts[:PARTS]]
    rows = [[part.get(name, "") for name in columns] for part in shown]
    processes = table(list(columns.values()), rows)
    more = f"and {len(source.parts) - PARTS} more." if len(source.parts) > PARTS else ""
    return joined(
        [
            folded("Processes", processes, element("p", more, class_="note") if more else "", shown=True),
            folded("Versions", facts(_versions(source.parts)), shown=True),
        ]
    )


def _versions(parts: Sequence[Mapping[str, Any]]) -> list[tuple[str, object]]:
    found: dict[str, dict[str, None]] = {}
    for part in parts:
        for name, version in part.get("versions", {}).items():
            found.setdefault(name, {})[version] = None
    return [(name, ", ".join(versions)) for name, versions in found.items()]


def _clock(moment: str) -> str:
    return moment.replace("T", " ").replace("+00:00", " UTC")


def value(setting: Any) -> str:
    """A setting as text."""
    if setting is None:
        return "-"
    if isinstance(setting, bool):
        return "on" if setting else "off"
    if isinstance(setting, list):
        return ", ".join(map(value, setting)) or "none"
    return str(setting) if setting != "" else "none"
