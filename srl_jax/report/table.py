"""The closing table of a run, as rows of text."""

from collections.abc import Mapping
from typing import Any

from srl_jax.report.style import thousands


def format_table(summary: Mapping[str, Any]) -> list[list[str]]:
    """Rows of text for a closing table; the first one is the header.

    The columns are method, success, return, area, retained and steps to finish, each `.93 [.91, .95]`; `-`
    stands for what was not recorded and `never` for a threshold that was not reached. The area is that under
    success for `p2p` and under return otherwise.

    Args:
        summary: from `report.summarise`.
    """
    area = "area_success" if summary["task"] == "p2p" else "area_return"
    keys = ("success", "return", area, "retained", "steps_to_finish")
    rows = [["method", "success", "return", "area", "retained", "steps to finish"]]
    for label, method in summary["methods"].items():
        rows.append([label, *(cell(key, method["overall"].get(key)) for key in keys)])
    return rows


def cell(key: str, entry: Mapping[str, float | None] | None) -> str:
    """An entry of a summary as text, such as `.93 [.91, .95]`; `key` is its name there."""
    if entry is None:
        return "-"
    numbers = [entry["iqm"], entry["low"], entry["high"]]
    largest = max((abs(number) for number in numbers if number is not None), default=0.0)
    decimals = 2 if largest < 10 else 1 if largest < 100 else 0

    def text(number: float | None) -> str:
        if number is None:
            return "never"
        if key == "steps_to_finish":
            return thousands(float(f"{number:.3g}"))
        plain = f"{round(number, decimals) + 0.0:.{decimals}f}"  # no minus before what is nothing
        return plain.replace("0.", ".", 1) if plain.startswith(("0.", "-0.")) else plain

    point, low, high = map(text, numbers)
    return point if point == low == high == "never" else f"{point} [{low}, {high}]"
