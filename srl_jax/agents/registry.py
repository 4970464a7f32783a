"""Which module is behind a configuration, and what the training program expects of such a module.

An agent is a module of pure functions of one lane: ``init``, ``act``, ``student`` (the policy that is evaluated,
without noise), ``update``, and ``METRICS``, the names of what its update measures. Its state is a NamedTuple with the
fields ``actor`` (what ``student`` reads) and ``critic``. An episodic agent, which learns from whole episodes, also has
``finish(state, episodes, *, config, hyper)``.
"""

import importlib
from types import ModuleType
from typing import Any

from srl_jax.agents import settings

_MODULES = {
    settings.DDPGConfig: "srl_jax.agents.ddpg",
    settings.SRLConfig: "srl_jax.agents.srl",
    settings.BACConfig: "srl_jax.agents.bac",
    settings.FrozenConfig: "srl_jax.agents.frozen",
    settings.ITEConfig: "srl_jax.ite.agent",
    settings.SearchConfig: "srl_jax.agents.search",
}


def module(config: Any) -> ModuleType:
    """The agent's functions; a module is imported when it is first used."""
    return importlib.import_module(_MODULES[type(config)])


def is_episodic(config: Any) -> bool:
    """Whether the agent learns from finished episodes."""
    return hasattr(module(config), "finish")
