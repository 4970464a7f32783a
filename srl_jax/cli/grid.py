"""Settings that cannot differ inside one program, combined on the command line: ``--grid srl.hidden=64,64;128,128``."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

from srl_jax.agents.sweep import AgentSettings, swept_fields
from srl_jax.config import Config


def combinations(grid: Sequence[str], arguments: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Every combination: its label, and the command line of a run with it.

    Args:
        grid: of ``name=value;value`` each.
        arguments: of the run otherwise.

    Raises:
        ValueError: a name is no setting, or has no value.
    """
    axes = [_axis(text) for text in grid]
    names = [name for name, _ in axes]
    if len(set(names)) < len(names):
        raise ValueError(f"grid has {', '.join(names)}: name each setting once.")
    for values in itertools.product(*(values for _, values in axes)):
        label = " ".join(f"{name}={value}" for name, value in zip(names, values, strict=True))
        extra = [word for name, value in zip(names, values, strict=True) for word in _option(name, value)]
        yield label, [*arguments, *extra]


def _axis(text: str) -> tuple[str, list[str]]:
    name, equals, values = text.partition("=")
    found = [value.strip() for value in values.split(";") if value.strip()]
    if not equals or not found or len(set(found)) < len(found):
        raise ValueError(f"grid has {text!r}: write name=value;value, such as srl.hidden=64,64;128,128.")
    _field(name)
    return name, found


def _option(name: str, value: str) -> list[str]:
    owner, field = _field(name)
    flag = "--" + name.replace("_", "-")
    kind = getattr(owner, field)
    if isinstance(kind, bool):
        return [flag if value.lower() == "true" else f"{flag.rpartition('.')[0]}.no-{field.replace('_', '-')}"]
    whole = isinstance(owner, AgentSettings) and field in swept_fields(type(owner))
    words = [word for word in value.split(",") if word] if isinstance(kind, tuple) and not whole else [value]
    return [flag, *words]


def _field(name: str) -> tuple[object, str]:
    """The settings that have a field, and its name there."""
    owner: object = Config()
    *sections, field = name.replace("-", "_").split(".")
    for section in sections:
        owner = getattr(owner, section, None)
    fields = {f.name for f in dataclasses.fields(owner)} if dataclasses.is_dataclass(owner) else set()
    if field not in fields or field == "more":
        raise ValueError(
            f"grid has {name!r}: that is no setting of a run, such as srl.hidden, train.update_every, task."
        )
    return owner, field
