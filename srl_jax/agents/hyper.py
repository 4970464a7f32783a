"""Numeric hyper-parameters as arrays, so that lanes may differ in them without another program."""

from collections import namedtuple
from functools import cache
from typing import Any, Protocol, cast

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents.sweep import AgentSettings, swept_fields, variants

__all__ = ["Hyper", "from_config", "hyper_type", "stack", "variants"]


class Hyper(Protocol):
    """One lane's values, each f32[]: a NamedTuple of the fields of its settings that may be swept.

    Meanings stand at the fields of the same name in `agents.settings`.
    """

    def __getattr__(self, name: str) -> jax.Array: ...

    def _replace(self, **values: jax.Array) -> "Hyper": ...


@cache
def hyper_type(settings: type[AgentSettings]) -> Any:
    """The NamedTuple of a class of settings, the same at every call, as a pytree's type must be."""
    return namedtuple(settings.__name__.removesuffix("Config") + "Hyper", swept_fields(settings))


def from_config(config: AgentSettings, **chosen: float) -> Hyper:
    """The hyper-parameters of a config, with `chosen` values in place of its first ones."""
    kind = hyper_type(type(config))
    values = {name: getattr(config, name)[0] for name in kind._fields} | chosen
    return cast(Hyper, kind(**{name: jnp.float32(value) for name, value in values.items()}))


def stack(config: AgentSettings, rows: list[dict[str, float]]) -> Hyper:
    """The hyper-parameters of n lanes, leaves f32[n] on the host, from the values that each has chosen."""
    kind = hyper_type(type(config))
    default = {name: getattr(config, name)[0] for name in kind._fields}
    columns = {name: np.full(len(rows), value, np.float32) for name, value in default.items()}
    for index, chosen in enumerate(rows):
        for name, value in chosen.items():
            columns[name][index] = value
    return cast(Hyper, kind(**columns))
