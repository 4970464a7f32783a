"""What a run has shown, in a sentence or two, and what it consisted of."""

from collections.abc import Mapping
from typing import Any

from srl_jax.report import style
from srl_jax.report.data import RunData
from srl_jax.report.panels import CONTROL_HZ
from srl_jax.report.table import cell

TASKS = {"x": "walk along x", "xy": "walk in any direction", "p2p": "reach a point"}
SAID = {  # entry of a summary -> (what a method does, what follows its number)
    "success": ("reaches the goal in", "of its episodes"),
    "retained": ("keeps", "of the healthy robot's speed"),
    "return": ("returns", "an episode"),
}
RIVALS = 3  # that are named after the best method


def measure(run: RunData, summary: Mapping[str, Any]) -> str:
    """The entry that methods are told by: success or retained speed, or what old runs have in their place."""
    wanted = ("success", "return") if run.task == "p2p" else ("retained", "return")
    overall = [method["overall"] for method in summary["methods"].values()]
    return next((key for key in wanted if any(_height(entries, key) is not None for entries in overall)), "")


def lead(run: RunData, summary: Mapping[str, Any]) -> list[str]:
    """The best method and its rivals, what pi_B alone is worth, and how sure it is that the best is better.

    Args:
        run: whose lanes the summary is of.
        summary: from `report.summarise`.
    """
    key = measure(run, summary)
    if not key:
        return ["Nothing has been evaluated yet."]
    overall = {label: method["overall"] for label, method in summary["methods"].items()}
    found = {label: (_height(entries, key), _height(entries, "return")) for label, entries in overall.items()}
    heights = {label: (height, earned or 0.0) for label, (height, earned) in found.items() if height is not None}
    ranked = sorted(heights, key=heights.__getitem__, reverse=True)  # of equals the one that earns more comes first
    names = {group.label: style.name(group) for group in run.groups}
    best, *others = ranked
    does, of = SAID[key]
    said = f"{names.get(best, best)} {does} {cell(key, overall[best][key])} {of}"
    rivals = [f"{names.get(label, label)} {cell(key, overall[label][key])}" for label in others[:RIVALS]]
    if teacher := overall[best].get(f"teacher_{key}"):
        rivals.append(f"the frozen policy from before the damage {cell(key, teacher)}")
    few = f"Of {len(ranked)} methods " if len(ranked) > RIVALS + 1 else ""
    return [f"{few}{said}{''.join(f'; {rival}' for rival in rivals)}.", *_better(run, summary, (best, *others[:1]))]


def _better(run: RunData, summary: Mapping[str, Any], pair: tuple[str, ...]) -> list[str]:
    # Of the best method and the next; none where they were not compared.
    score = "area_success" if run.task == "p2p" else "area_return"
    names = {group.label: style.name(group) for group in run.groups}
    return [
        f"By the {score.replace('_', ' under ')}, {names.get(found['x'], found['x'])} is better than "
        f"{names.get(found['y'], found['y'])} with probability {chance(found)}."
        for found in summary.get("improvement", [])
        if (found["x"], found["y"]) == pair and found["score"] == score
    ]


def chance(found: Mapping[str, Any]) -> str:
    """A probability of improvement with its interval."""
    return cell("probability", {"iqm": found["probability"], "low": found["low"], "high": found["high"]})


def duration(steps: float) -> str:
    """Robot time of so many control steps."""
    return spent(steps / CONTROL_HZ)


def spent(seconds: float) -> str:
    """A time in the unit that suits it."""
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} s"


def counted(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _height(entries: Mapping[str, Any], key: str) -> float | None:
    found = entries.get(key)
    return None if found is None else found["iqm"]
