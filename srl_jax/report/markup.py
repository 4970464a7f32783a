"""Pieces of HTML: whatever is not of the type that says so is text, and is escaped."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

CSS = Path(__file__).with_name("page.css")


class Html(str):
    """Markup, which is not escaped again."""


def text(value: object) -> Html:
    """Anything as markup."""
    return value if isinstance(value, Html) else Html(escape(str(value)))


def element(tag: str, *inside: object, **attributes: str) -> Html:
    """``<tag attributes>inside</tag>``; an attribute whose name is a word of Python has an underscore at its end."""
    words = "".join(f' {name.rstrip("_")}="{escape(value)}"' for name, value in attributes.items())
    return Html(f"<{tag}{words}>{''.join(map(text, inside))}</{tag}>")


def joined(parts: Iterable[object], between: Html | None = None) -> Html:
    """Pieces one after the other."""
    return Html((between or "").join(map(text, parts)))


def section(title: str, *inside: object, note: str = "") -> Html:
    """A part of the page with a heading; empty where there is nothing in it."""
    if not any(inside):
        return Html()
    told = element("p", note, class_="note") if note else ""
    return element("section", element("h2", title), told, *inside)


def table(header: Sequence[object], rows: Iterable[Sequence[object]]) -> Html:
    """A table in a box of its own, in which it scrolls where the page is too narrow; first cells name their rows."""
    head = element("tr", *(element("th", x, scope="col") for x in header))
    body = (
        element("tr", element("th", first, scope="row"), *(element("td", x) for x in rest)) for first, *rest in rows
    )
    whole = element("table", element("thead", head), element("tbody", *body))
    return element("div", whole, class_="scroll", tabindex="0")


def facts(pairs: Iterable[tuple[str, object]]) -> Html:
    """Names with their values; those without a value are left out."""
    kept = ((name, value) for name, value in pairs if value not in ("", None))
    return element("dl", *(element("div", element("dt", name), element("dd", value)) for name, value in kept))


def interval(cell: str) -> Html:
    """`.93 [.91, .95]` with its interval set back."""
    point, bracket, rest = unbroken(cell).partition("\u00a0[")
    return joined([point, element("small", bracket + rest) if bracket else ""])


def breakable(name: str) -> Html:
    """A name of several damages, which a line may end between."""
    return joined(name.split("+"), Html("+<wbr>"))


def unbroken(sentence: str) -> str:
    """A sentence whose intervals stay with their numbers where a line ends."""
    return re.sub(r" \[[^\]]*\]", lambda found: found[0].replace(" ", "\u00a0"), sentence)


def folded(title: str, *inside: object, shown: bool) -> Html:
    """What can be folded away."""
    opened = " open" if shown else ""
    return Html(f"<details{opened}>{element('summary', title)}{joined(inside)}</details>")


def document(title: str, style: str, *inside: object) -> str:
    """A whole page, with its style in it.

    Args:
        title: of the window.
        style: CSS beside that of `page.css`.
        inside: the body.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"{element('title', title)}<style>{style}\n{CSS.read_text()}</style></head>\n"
        f"<body>{element('main', *inside)}</body></html>\n"
    )
