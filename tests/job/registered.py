"""An algorithm that somebody else wrote, registered for one test."""

from dataclasses import dataclass

import pytest

from srl_jax.agents import registry
from srl_jax.agents.sweep import AgentSettings, Share


@dataclass(frozen=True)
class MySettings(AgentSettings):
    """Its settings."""

    rate: Share = (0.5,)
    """How fast it goes."""
    layers: int = 2


@pytest.fixture(name="mine")
def _mine(monkeypatch):
    """Registered, and forgotten afterwards."""
    monkeypatch.setattr(registry, "_algorithms", {**registry._algorithms})
    monkeypatch.setattr(registry, "_makers", {**registry._makers})
    registry.register("mine", MySettings(), "nowhere.mine")
