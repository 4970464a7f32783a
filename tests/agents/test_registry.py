"""Which algorithms there are: those that ship, complete, and those that others add."""

import importlib
import inspect
import subprocess
import sys
from dataclasses import dataclass

import pytest

from srl_jax.agents import interface, registry
from srl_jax.agents.interface import Agent
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.agents.sweep import AgentSettings, Sweep

PROTOCOLS = {
    "init": interface.Init,
    "act": interface.Act,
    "student": interface.Student,
    "update": interface.Update,
    "finish": interface.Finish,
}
MAIN_JOB = """
import sys
from srl_jax.job import run
from srl_jax.agents import registry
for algo in ("ddpg", "srl", "ddpg_warm", "acteach"):
    registry.agent(registry.settings(algo))
print(*[name for name in sys.modules if name.startswith(("srl_jax.ite", "srl_jax.bayes", "srl_jax.agents"))])
"""
PLUGIN = '''
from dataclasses import dataclass

from srl_jax.agents import register
from srl_jax.agents.sweep import AgentSettings


@dataclass(frozen=True)
class LazyConfig(AgentSettings):
    """One that does nothing."""


def agent(config):
    raise NotImplementedError


def add():
    register("lazy", LazyConfig(), __name__)
'''


@dataclass(frozen=True)
class OwnConfig(AgentSettings):
    """A third party's settings."""

    boldness: Sweep = (1.0,)


def make(config: OwnConfig) -> Agent:
    return Agent(*(lambda *args, **keywords: config.boldness for _ in range(3)))


@pytest.fixture(autouse=True)
def shipped_again(monkeypatch):
    """Algorithms that a test adds are gone after it."""
    registry.names()
    monkeypatch.setattr(registry, "_algorithms", dict(registry._algorithms))
    monkeypatch.setattr(registry, "_makers", dict(registry._makers))


@pytest.mark.parametrize("algo", registry.SHIPPED)
def test_a_shipped_algorithms_record_is_complete(algo):
    config = registry.settings(algo)
    agent = registry.agent(config)
    assert agent is registry.agent(config), "the same record for equal settings"
    for name, protocol in PROTOCOLS.items():
        function = getattr(agent, name)
        if function is None:
            continue
        wanted = list(inspect.signature(protocol.__call__).parameters.values())[1:]
        positional = [p for p in wanted if p.kind is p.POSITIONAL_OR_KEYWORD]
        keywords = {p.name: p for p in wanted if p.kind is p.KEYWORD_ONLY}
        # Bound as the program calls it, nothing is missing and nothing is unknown; teachers may be left out.
        signature = inspect.signature(function)
        signature.bind(*positional, **keywords)
        keywords.pop("teachers", None)
        signature.bind(*positional, **keywords)
    assert agent.replays == (agent.update is not None) == bool(agent.metrics), "what replays learns, and says so"
    learns = agent.update or agent.finish
    assert (agent.gauge is not None) == (agent.finish is not None)
    assert learns or algo in ("tripod", "pi_b")
    assert agent.own_gait == (algo == "tripod")
    assert (agent.adopt is not None) == (getattr(config, "init", None) == "behaviour")
    assert (agent.network is None) == (agent.update is None)


@pytest.mark.parametrize("algo", ["ddpg", "srl", "acteach", "bac"])
def test_a_batch_is_what_the_settings_ask_for(algo):
    config = registry.settings(algo)
    assert registry.agent(config).batch_size == config.batch * getattr(config, "critic_updates", 1)


def test_healthy_transitions_are_for_those_that_replay_them():
    assert not registry.agent(SRLConfig()).replays_healthy
    assert registry.agent(SRLConfig(prior_fraction=(0.0, 0.5))).replays_healthy


def test_names_and_settings_of_what_ships():
    assert registry.names()[: len(registry.SHIPPED)] == tuple(registry.SHIPPED)
    assert registry.settings("ddpg_warm").init == "behaviour" and registry.settings("srl") == SRLConfig()


def test_an_unknown_name_is_refused_in_a_sentence():
    with pytest.raises(ValueError, match=r"^algos has 'ppo': choose from ddpg, srl, .*, pi_b.*\.$"):
        registry.settings("ppo")


def test_anybody_may_register_an_algorithm():
    registry.register("own", OwnConfig(), make)
    assert registry.names()[-1] == "own" and registry.settings("own") == OwnConfig()
    assert registry.agent(OwnConfig(boldness=(2.0,))).act() == (2.0,)
    registry.register("own", OwnConfig(), make)  # as a module does that is imported twice
    assert registry.names().count("own") == 1
    registry.register("bolder", OwnConfig(boldness=(9.0,)), make)  # other defaults of the same
    assert registry.agent(registry.settings("bolder")).act() == (9.0,)


@pytest.mark.parametrize("name", ["srl", "two words", "3rd", ""])
def test_a_name_that_is_taken_or_none_is_refused(name):
    with pytest.raises(ValueError, match=f"name is {name!r}: give an identifier that is none of ddpg, srl"):
        registry.register(name, OwnConfig(), make)
    assert OwnConfig not in registry._makers


def test_settings_belong_to_one_algorithm_and_derive_from_the_base():
    with pytest.raises(ValueError, match="defaults of own are of DDPGConfig: derive a class of its own"):
        registry.register("own", DDPGConfig(hidden=(8,)), make)
    with pytest.raises(ValueError, match="defaults of own are of dict"):
        registry.register("own", {}, make)  # type: ignore[arg-type]
    assert "own" not in registry.names()


def test_settings_that_nobody_registered_make_no_agent():
    with pytest.raises(ValueError, match="config is of OwnConfig, with which no algorithm was registered"):
        registry.agent(OwnConfig(boldness=(3.0,)))


def test_an_installed_package_adds_its_algorithm(tmp_path, monkeypatch):
    (tmp_path / "lazy_plugin.py").write_text(PLUGIN)
    about = tmp_path / "lazy_plugin-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lazy-plugin\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{registry.ENTRY_POINTS}]\nlazy = lazy_plugin:add\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    assert "lazy" not in registry.names()
    registry._load_entry_points.cache_clear()
    try:
        assert "lazy" in registry.names()
        assert type(registry.settings("lazy")).__name__ == "LazyConfig"
        with pytest.raises(NotImplementedError):
            registry.agent(registry.settings("lazy"))
    finally:
        sys.modules.pop("lazy_plugin", None)


def test_the_main_job_imports_nothing_that_it_does_not_use():
    found = subprocess.run([sys.executable, "-c", MAIN_JOB], capture_output=True, text=True, check=True).stdout.split()
    assert "srl_jax.agents.srl" in found and "srl_jax.bayes.dropout" in found
    unused = {"quadrature", "gptd", "gram", "value", "calibration", "guidance"}
    assert not [name for name in found if name.startswith("srl_jax.ite") or name.rpartition(".")[2] in unused]
    assert not {"srl_jax.agents.search", "srl_jax.agents.bac", "srl_jax.agents.frozen"} & set(found)
