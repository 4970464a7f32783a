"""How all figures look, what methods are called in them, and how they are written."""

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from srl_jax.report.data import Group

NAMES = {"ddpg": "DDPG", "srl": "SRL", "acteach": "AC-Teach", "rlpd": "RLPD", "ibrl": "IBRL", "jsrl": "JSRL"}
# Okabe & Ito: told apart with common colour blindness. The paper's two methods look the same in all runs.
FIXED = {"srl": "#0072B2", "ddpg": "#D55E00"}
PALETTE = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444", "#0072B2", "#D55E00")
OTHERS = "#bbbbbb"  # of curves that have no name of their own
STYLE: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": "#222222",
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
}
Looks = Mapping["Group", Mapping[str, Any]]


def looks(groups: Iterable["Group"], named: Iterable["Group"]) -> dict["Group", dict[str, Any]]:
    """Line style, colour and label of each method; what is not `named` is grey and without a label."""
    groups, named = list(groups), set(named)
    # Dashed and dotted are kept for the reference lines.
    styles = itertools.product(("-", "-.", (0, (7, 1.5))), PALETTE)
    fixed = {group: FIXED[group.algo] for group in named if group.algo in FIXED and not group.variant}
    free = (look for look in styles if look[0] != "-" or look[1] not in fixed.values())
    found: dict[Group, dict[str, Any]] = {}
    for group in groups:
        if group not in named:
            found[group] = {"linestyle": "-", "color": OTHERS}
            continue
        style, colour = ("-", fixed[group]) if group in fixed else next(free)
        found[group] = {"linestyle": style, "color": colour, "label": name(group)}
    return found


def name(group: "Group") -> str:
    """What a method is called in figures and sentences."""
    return f"{NAMES.get(group.algo, group.algo)} {group.variant}".strip()


def thousands(steps: float) -> str:
    """A number of steps, such as 12.3k."""
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if abs(steps) >= unit:
            return f"{steps / unit:.4g}{name}"
    return f"{steps:.4g}"


def save(figure: "Figure", path: str | Path) -> None:
    """Writes all of a PNG or nothing of it."""
    partial = Path(path).with_suffix(".partial")
    figure.savefig(partial, format="png")
    partial.replace(path)
