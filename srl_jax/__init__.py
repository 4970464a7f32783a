"""srl_jax: survivable control of a legged robot in JAX.

The public modules, imported on first use, so that the command line can set devices up before jax is imported::

    env.hexapod, env.damage, env.gait      the robot, what it loses, how it walks while healthy
    agents.ddpg, agents.srl                init, act, update: pure functions that know no robot
    bayes.dropout, .thompson, .controller  the critic as a posterior, and decisions from it
    program.replay, .step, evaluate        memory, the one compiled program, rollouts of a student
    atlas.file, .recovery                  policies made before the damage; a robot that finds out, walks on and learns
    pretrained                             policies that ship: observation -> action by NumPy alone
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from srl_jax import agents, atlas, bayes, config, env, evaluate, pretrained, program

__version__ = "0.1.0"
__all__ = ["agents", "atlas", "bayes", "config", "env", "evaluate", "pretrained", "program"]


def __getattr__(name: str) -> ModuleType:
    if name in __all__:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
