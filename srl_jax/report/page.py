"""One page of a run, or of several side by side: what was asked, what came of it, and how to do it again.

The page is a single file without a reference to any other, for dark and for light screens, phones and paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srl_jax.report import films, inline, sentences, style
from srl_jax.report.content import Content
from srl_jax.report.inline import Drawn
from srl_jax.report.markup import (
    Html,
    breakable,
    document,
    element,
    facts,
    folded,
    interval,
    joined,
    section,
    table,
    unbroken,
)
from srl_jax.report.provenance import provenance
from srl_jax.report.sentences import counted
from srl_jax.report.table import cell, format_table

SHOWN = 40  # lanes that failed which are named
OPEN = 12  # damages up to which their table is not folded away
PAIRS = 12  # methods up to which each is compared with each


def render(content: Content) -> str:
    """The page as HTML.

    Raises:
        ValueError: lanes do not fill seeds x damages.
    """
    drawn = inline.draw(content.run)
    colours = f":root {{ {inline.variables(dark=False)} }}"
    dark = f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {inline.variables(dark=True)} }} }}"
    name = " and ".join(source.name for source in content.sources)
    return document(
        f"{name}: srl_jax",
        f"{colours}\n{dark}",
        _header(name, content),
        _methods(content, drawn),
        _curves(content, drawn),
        _damages(content),
        _failed(content),
        _swept(content),
        _films(content),
        provenance(content),
        element("footer", "Numbers: summary.json and metrics.csv in the run's directory. Made by srl_jax."),
    )


def _header(name: str, content: Content) -> Html:
    run, summary = content.run, content.summary
    first, *more = sentences.lead(run, summary)
    return element(
        "header",
        element("p", f"Task {run.task}: {sentences.TASKS.get(run.task, run.task)}", class_="kicker"),
        element("h1", name),
        element("p", unbroken(first), class_="lead"),
        *(element("p", unbroken(sentence), class_="lead more") for sentence in more),
        _alerts(content),
        facts(_facts(content)),
    )


def _alerts(content: Content) -> Html:
    said = list(content.notes)
    if not content.finished:
        steps = f"{content.summary['steps']:,} of {content.run.config.get('steps', 0):,} steps"
        said.insert(0, f"This run is not finished: these are its first {steps}.")
    if failed := content.summary.get("nonfinite_lanes", []):
        said.append(f"{len(failed)} of {counted(len(content.run.lanes), 'lane')} met a number that is not finite.")
    return element("div", *(element("p", sentence) for sentence in said), class_="alert") if said else Html()


def _facts(content: Content) -> list[tuple[str, object]]:
    run, config = content.run, content.run.config
    damages = list(dict.fromkeys(lane["damage"] for lane in run.lanes))
    seeds = sorted({lane["seed"] for lane in run.lanes})
    consecutive = len(seeds) > 2 and seeds[-1] - seeds[0] == len(seeds) - 1
    steps = config.get("steps", content.summary["steps"])
    listed = ", ".join(damages) if len(damages) <= OPEN else f"{len(damages)}, listed below"
    return [
        ("Lanes", f"{len(run.lanes):,}: {counted(len(run.groups), 'method')}, {counted(len(damages), 'damage')}"),
        ("Damages", listed),
        ("Seeds", f"{seeds[0]} to {seeds[-1]}" if consecutive else ", ".join(map(str, seeds))),
        ("Steps of a lane", f"{steps:,}, {sentences.duration(steps)} of robot time"),
        ("Policy before the damage", config.get("behaviour", "")),
        ("Episodes of an evaluation", f"{run.episodes:,}"),
    ]


def _methods(content: Content, drawn: Drawn) -> Html:
    header, *rows = format_table(content.summary)
    names = {group.label: joined([Html(inline.key(look)), style.name(group)]) for group, look in drawn.looks.items()}
    whole = [[names.get(label, label), *map(interval, cells)] for label, *cells in rows]
    note = (
        "Interquartile mean over seeds and damages, with its 95 % bootstrap interval. Success and return: mean of the "
        "last two evaluations of the student alone. Area: mean height of the curve. Retained: distance over that of "
        "the healthy robot. Finish: 0.9 of each lane's own healthy return."
    )
    return section("Methods", table(header, whole), *_improvement(content), note=note) if rows else Html()


def _improvement(content: Content) -> list[Html]:
    """One table per score: with what probability the row's method is better than the column's."""
    found = content.summary.get("improvement", [])
    names = {group.label: style.name(group) for group in content.run.groups}
    labels = list(content.summary["methods"])
    down, across = (labels, labels) if len(labels) <= PAIRS else (labels[1:], labels[:1])
    done = []
    for score in dict.fromkeys(pair["score"] for pair in found):
        chances = {(p["x"], p["y"]): interval(sentences.chance(p)) for p in found if p["score"] == score}
        rows = [[names.get(x, x), *(chances.get((x, y), "") for y in across)] for x in down]
        heading = f"Better by the {score.replace('_', ' under ')}, with probability"
        whole = table(["", *(f"than {names.get(y, y)}" for y in across)], rows)
        done.append(element("div", element("h3", heading), whole))
    note = content.summary.get("improvement_note", "")
    return [element("div", *done, class_="beside"), *([element("p", note, class_="note")] if note else [])]


def _curves(content: Content, drawn: Drawn) -> Html:
    if not drawn.large:
        return Html()
    note = (
        "The student alone, without noise, against environment steps of a lane, with 95 % bands. Dashed: the policy "
        "from before the damage, frozen. Dotted: 0.9 of the healthy return."
    )
    unnamed = sum("label" not in look for look in drawn.looks.values())
    if unnamed:
        note += f" Grey: {unnamed} that end lower."
    small = (element("figure", element("figcaption", breakable(x)), Html(svg)) for x, svg in drawn.small.items())
    panels = element("div", *map(Html, drawn.large.values()), class_="panels large")
    return section("Curves", panels, element("div", *small, class_="panels small"), note=note)


def _damages(content: Content) -> Html:
    """The methods under every damage apart."""
    methods, names = content.summary["methods"], {group.label: style.name(group) for group in content.run.groups}
    damages = list(dict.fromkeys(damage for method in methods.values() for damage in method["conditions"]))
    key = sentences.measure(content.run, content.summary)
    if not key or len(damages) < 2:
        return Html()
    rows = [
        [
            breakable(damage),
            *(interval(cell(key, own["conditions"].get(damage, {}).get(key))) for own in methods.values()),
        ]
        for damage in damages
    ]
    whole = table(["damage", *(names.get(label, label) for label in methods)], rows)
    told = {"success": "Success", "retained": "Retained", "return": "Return"}[key]
    return section("Each damage", folded(f"{told} under {len(damages)} damages", whole, shown=len(damages) <= OPEN))


def _failed(content: Content) -> Html:
    lanes = content.summary.get("nonfinite_lanes", [])
    if not lanes:
        return Html()
    rows = [
        [x["lane"], f"{x['algo']} {x['variant']}".strip(), x["damage"], x["seed"], f"{x['step']:,}", _where(x)]
        for x in lanes[:SHOWN]
    ]
    more = element("p", f"and {len(lanes) - SHOWN} more.", class_="note") if len(lanes) > SHOWN else ""
    whole = table(["lane", "method", "damage", "seed", "step", "measured"], rows)
    return section(
        "Lanes that failed", whole, more, note="They count as failed from the step on at which that was seen."
    )


def _where(lane: dict[str, Any]) -> str:
    return ", ".join(lane.get("measured", []))


def _swept(content: Content) -> Html:
    found: Sequence[dict[str, Any]] = content.summary.get("sweep", {}).get("sensitivity", [])
    rows = [[x["algo"], x["setting"], x["value"], x["lanes"], interval(cell("area", x))] for x in found]
    header = ["algorithm", "setting", "value", "lanes", "area"]
    note = "Area under success (p2p) or under return, over all lanes that have the value."
    return section("What was swept", table(header, rows), note=note) if rows else Html()


def _films(content: Content) -> Html:
    shown = films.films(content.sources, list(content.run.groups))
    left = sum(len(source.videos) for source in content.sources) - len(shown)
    note = "Of each method the lane whose last return is the median, in C MuJoCo. On paper: the first picture."
    note += f" {left} more lie with the run." if left else ""
    return section("Videos", element("div", *shown, class_="films"), note=note) if shown else Html()
