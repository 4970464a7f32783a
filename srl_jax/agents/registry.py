"""Which algorithms there are: a name, its default settings, and where its functions lie.

This module imports no jax, so that ``--help`` answers at once; an algorithm's module is imported when it is first used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from importlib import metadata
from typing import TYPE_CHECKING, Any

from srl_jax.agents.rivals import ACTEACH, IBRL, RLPD, JumpStartConfig
from srl_jax.agents.settings import (
    DDPG,
    WARM_START,
    BACConfig,
    DDPGConfig,
    FrozenConfig,
    ITEConfig,
    SearchConfig,
    SRLConfig,
)
from srl_jax.agents.sweep import AgentSettings

if TYPE_CHECKING:
    from srl_jax.agents.interface import Agent

ENTRY_POINTS = "srl_jax.agents"  # each is a function without arguments that calls `register`
SHIPPED: dict[str, AgentSettings] = {
    "ddpg": DDPG,
    "srl": SRLConfig(),
    "ddpg_warm": WARM_START,
    "acteach": ACTEACH,
    "rlpd": RLPD,
    "ibrl": IBRL,
    "jsrl": JumpStartConfig(),
    "bac": BACConfig(),
    "mcpg": SearchConfig(),
    "bpg": SearchConfig(estimator="model2"),
    "ite": ITEConfig(),
    "tripod": FrozenConfig(policy="tripod"),
    "pi_b": FrozenConfig(),
}
Make = Callable[[Any], "Agent"]

_algorithms: dict[str, AgentSettings] = dict(SHIPPED)
_makers: dict[type[AgentSettings], str | Make] = {
    DDPGConfig: "srl_jax.agents.ddpg",
    SRLConfig: "srl_jax.agents.srl",
    JumpStartConfig: "srl_jax.agents.jump_start",
    BACConfig: "srl_jax.agents.bac",
    FrozenConfig: "srl_jax.agents.frozen",
    ITEConfig: "srl_jax.ite.agent",
    SearchConfig: "srl_jax.agents.search",
}


def register(name: str, defaults: AgentSettings, make: str | Make) -> None:
    """Makes an algorithm known by name, beside those that ship: ``--algos name``, ``--name.field value``.

    Args:
        name: an identifier that is not taken; registering the same again changes nothing.
        defaults: its settings, a frozen dataclass derived from `AgentSettings`; its class belongs to `make` alone.
        make: ``settings -> Agent``, or the module that has it under the name ``agent`` (imported at first use).

    Raises:
        ValueError: the name is no identifier or is taken, or the class of the settings belongs to another `make`.
    """
    kind = type(defaults)
    if not name.isidentifier() or _algorithms.get(name, defaults) != defaults:
        raise ValueError(f"name is {name!r}: give an identifier that is none of {', '.join(_algorithms)}.")
    if not issubclass(kind, AgentSettings) or _makers.get(kind, make) != make:
        raise ValueError(f"defaults of {name} are of {kind.__name__}: derive a class of its own from AgentSettings.")
    _algorithms[name], _makers[kind] = defaults, make


@cache
def _load_entry_points() -> None:
    for point in metadata.entry_points(group=ENTRY_POINTS):
        point.load()()


def names() -> tuple[str, ...]:
    """Every algorithm's name, those of installed packages included."""
    _load_entry_points()
    return tuple(_algorithms)


def settings(name: str) -> AgentSettings:
    """The default settings of an algorithm.

    Raises:
        ValueError: there is none of that name.
    """
    if name not in names():
        raise ValueError(f"algos has {name!r}: choose from {', '.join(names())}.")
    return _algorithms[name]


@cache
def agent(config: AgentSettings) -> Agent:
    """The functions of an algorithm with these settings; the same record for equal settings.

    Raises:
        ValueError: no algorithm was registered with such settings.
    """
    make = _makers.get(type(config))
    if make is None:
        raise ValueError(f"config is of {type(config).__name__}, with which no algorithm was registered.")
    return importlib.import_module(make).agent(config) if isinstance(make, str) else make(config)
