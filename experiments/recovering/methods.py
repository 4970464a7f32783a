"""By what robots go on: the atlas with its posterior and what it learns, parts of that, and who knows more or less."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from experiments.recovering.rows import Case
from srl_jax.atlas import recovery
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.mind import Scope
from srl_jax.atlas.robots import CRobot


class Method(NamedTuple):
    """How a robot chooses."""

    said: str
    rule: str = "greedy"
    blind: bool = False  # from the strike on it has trials alone
    knows: str = ""  # oracle: the best policy of its atlas is named; healthy: it goes on as if nothing were
    composes: bool = True
    learns: bool = False


METHODS = {
    "learning": Method("posterior, and SRL in the twin", learns=True),
    "posterior": Method("posterior"),
    "thompson": Method("posterior, Thompson's draw", rule="thompson"),
    "foreseen-only": Method("posterior over the atlas alone", composes=False),
    "nearest": Method("the likeliest damage's policy", rule="likeliest", composes=False),
    "trials": Method("trial and error over the atlas", blind=True, composes=False),
    "uniform": Method("any policy, each segment anew", rule="uniform", composes=False),
    "healthy": Method("the healthy robot's policy", knows="healthy", composes=False),
    "oracle": Method("the best policy of the atlas, told", knows="oracle", composes=False),
}


def scopes(
    atlas: Atlas, method: Method, cases: Sequence[Case], bodies: Sequence[CRobot]
) -> Callable[[int], list[Scope]]:
    """What each robot may use at a control step, and what it is told."""
    healthy = int(np.argmax(atlas.value[:, 0]))
    each = []
    for case in cases:
        own = recovery.scope(atlas, case.without, rule=method.rule)
        before = own._replace(told=np.array(healthy if method.knows else -1))
        told = {"": -1, "healthy": healthy}.get(method.knows)
        if told is None:
            told = int(np.argmax(np.where(own.policies, recovery.worth(atlas, case.damage), -np.inf)))
        each.append((before, own._replace(told=np.array(told), blind=np.array(method.blind))))

    def at(step: int) -> list[Scope]:
        return [pair[step >= body.strike] for pair, body in zip(each, bodies, strict=True)]

    return at
