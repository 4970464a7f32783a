"""Every algorithm has a module of the agreed shape, and a run imports none that it does not use."""

import inspect
import subprocess
import sys

import pytest

from srl_jax.agents import registry
from srl_jax.config import ALGORITHMS, Config

MAIN_JOB = """
import sys
from srl_jax.job import loop
from srl_jax.agents import registry
from srl_jax.config import Config
for algo in ("ddpg", "srl", "ddpg_warm", "acteach"):
    registry.module(getattr(Config(), algo))
print(*[name for name in sys.modules if name.startswith(("srl_jax.ite", "srl_jax.bayes", "srl_jax.agents"))])
"""


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_an_agent_has_the_functions_that_training_calls(algo):
    module = registry.module(getattr(Config(), algo))
    keywords = {"init": {"config", "teachers"}, "student": {"config", "teachers"}}
    keywords |= {name: {"config", "hyper", "step", "teachers"} for name in ("act", "update")}
    if registry.is_episodic(getattr(Config(), algo)):
        keywords["finish"] = {"config", "hyper"}
    for name, wanted in keywords.items():
        assert wanted <= set(inspect.signature(getattr(module, name)).parameters), name
    assert isinstance(module.METRICS, tuple)


def test_the_main_job_imports_nothing_that_it_does_not_use():
    found = subprocess.run([sys.executable, "-c", MAIN_JOB], capture_output=True, text=True, check=True).stdout.split()
    assert "srl_jax.agents.srl" in found and "srl_jax.bayes.dropout" in found
    unused = {"quadrature", "gptd", "gram", "value", "calibration", "guidance"}
    assert not [name for name in found if name.startswith("srl_jax.ite") or name.rpartition(".")[2] in unused]
    assert not {"srl_jax.agents.search", "srl_jax.agents.bac", "srl_jax.agents.frozen"} & set(found)
