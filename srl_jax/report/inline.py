"""The figures of a page: a run's curves as SVG that stands in the text, every panel apart, for dark and for light.

The panels are those of `curves.png`. Each is an element of its own, so that the browser lays them out for the width
that there is; text stays text, and colours are variables of the page's style.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from srl_jax.report import curves, panels, style
from srl_jax.report.data import RunData
from srl_jax.report.style import Looks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGE, SMALL = (5.0, 3.7), (1.9, 1.45)  # inches
INK = {  # colour of a figure on paper -> on a dark screen; curves are lifted until they stand out
    "#000000": "#e7e9ec",
    "#111111": "#e7e9ec",
    "#222222": "#e7e9ec",
    "#444444": "#b4bac3",
    "#555555": "#b4bac3",
    "#666666": "#7d8590",
    "#e6e6e6": "#2c3138",
    "#bbbbbb": "#5d646e",
    "#0072b2": "#4ba6e0",
    "#d55e00": "#f08339",
    "#009e73": "#2cc79b",
    "#cc79a7": "#dd94bd",
    "#e69f00": "#f0b53a",
    "#56b4e9": "#8ccdf5",
}
# What the page's style says for all figures, or what nobody reads.
LEFT_OUT = re.compile(
    r"<metadata>.*?</metadata>|<!--.*?-->|<defs>\s*<style.*?</style>\s*</defs>|font-family: [^;\"]*;? ?"
    r"| transform=\"rotate\(-0 [^)]*\)\"",
    re.DOTALL,
)
RC: Any = style.STYLE | {"svg.fonttype": "none", "text.color": "#222222"}
DASHES = {"-": "", "-.": "10 3 2 3"}  # of a line in the table; others are lengths themselves


class Drawn(NamedTuple):
    """The curves of a run as SVG."""

    large: dict[str, str]  # what it shows -> the panel of a metric
    small: dict[str, str]  # damage -> its panel, where there are several
    looks: Looks  # how each method is drawn


def draw(run: RunData) -> Drawn:
    """All panels; none where nothing was evaluated yet.

    Raises:
        ValueError: lanes do not fill seeds x damages.
    """
    from matplotlib import rc_context

    metrics = curves.shown(run)
    if not metrics:
        return Drawn({}, {}, style.looks(run.groups, list(run.groups)[: curves.NAMED]))
    looks = style.looks(run.groups, curves.highest([run], metrics[0]))
    damages = list(dict.fromkeys(lane["damage"] for lane in run.lanes))
    with rc_context(RC):
        large = {f"{panels.LABELS[x]} against environment steps": _large(run, x, looks) for x in metrics}
        small = _small(run, metrics[0], damages, looks) if len(damages) > 1 else {}
        return Drawn(_svgs(large, "large"), _svgs(small, "small"), looks)


def _large(run: RunData, metric: str, looks: Looks) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=LARGE, layout="constrained")
    panels.large(figure.subplots(), run, metric, looks)
    return figure


def _small(run: RunData, metric: str, damages: Sequence[str], looks: Looks) -> dict[str, Figure]:
    from matplotlib.figure import Figure

    figures = {damage: Figure(figsize=SMALL) for damage in damages}
    # Places are fixed: to find them anew for every one of 76 panels would take seconds.
    places = {"left": 0.18, "right": 0.97, "top": 0.97, "bottom": 0.15}
    axes = {damage: figure.subplots(gridspec_kw=places) for damage, figure in figures.items()}
    for damage, own in axes.items():
        panels.one(own, run, metric, damage, looks)
        own.set_title("")  # stands above it in the page, where long names are broken
    panels.share_limits(list(axes.values()))
    return figures


def _svgs(figures: Mapping[str, Figure], prefix: str) -> dict[str, str]:
    # No two elements of the page have the same name inside.
    return {label: _svg(figure, label, f"{prefix}{n}-") for n, (label, figure) in enumerate(figures.items())}


def key(look: Mapping[str, Any]) -> str:
    """A piece of a method's line, for the table."""
    line = look["linestyle"]
    dashes = DASHES[line] if isinstance(line, str) else " ".join(f"{2 * length:g}" for length in line[1])
    return (
        '<svg class="key" viewBox="0 0 30 8" aria-hidden="true"><line x1="1" x2="29" y1="4" y2="4" '
        f'stroke="{_variable(look["color"])}" stroke-width="3" stroke-dasharray="{dashes}"/></svg>'
    )


def variables(*, dark: bool) -> str:
    """The colours as CSS."""
    return " ".join(f"{_name(light)}: {screen if dark else light};" for light, screen in INK.items())


def _name(colour: str) -> str:
    return "--ink-" + colour[1:].lower()


def _variable(colour: str) -> str:
    return f"var({_name(colour)})" if colour.lower() in INK else colour


def _svg(figure: Figure, label: str, prefix: str) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    drawn = text.getvalue()
    opening, body = drawn[drawn.index("<svg") :].split(">", 1)
    box = opening.partition('viewBox="')[2].partition('"')[0]
    body = LEFT_OUT.sub("", body).replace("xlink:href", "href")
    # Only what is referred to needs a name, and one that no other figure of the page has.
    names = dict.fromkeys(re.findall(r'(?:url\(|href=")#([^)"]+)', body))
    short = {name: f"{prefix}{n}" for n, name in enumerate(names)}
    body = re.sub(r' id="([^"]+)"', lambda m: f' id="{short[m[1]]}"' if m[1] in short else "", body)
    body = re.sub(r'(url\(#|href="#)([^)"]+)', lambda m: m[1] + short[m[2]], body)
    body = re.sub(r"#[0-9a-f]{6}\b", lambda m: _variable(m[0]), body)
    body = re.sub(r"\d+\.\d{3,}", lambda m: f"{float(m[0]):.2f}", body)
    body = re.sub(r"\s*\n\s*", " ", body).strip()
    return f'<svg role="img" aria-label="{escape(label)}" viewBox="{box}">{body}'
