"""Who walks: a policy to take home, or pi_B, with what it must be shown."""

from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import jax
import numpy as np

from srl_jax.env import gait as gaits
from srl_jax.env.anatomy import PHANTOMX
from srl_jax.env.interface import layout
from srl_jax.env.settings import TASKS
from srl_jax.portable import Policy

Kind = Literal["onboard", "rates", "full"]  # of observation
KINDS: tuple[Kind, ...] = get_args(Kind)


class Walker(NamedTuple):
    """A function of the observation."""

    name: str  # in words
    act: Callable[[np.ndarray], np.ndarray]  # f32[O] -> f32[18] in [-1, 1]
    task: str
    kind: Kind  # of its observation
    clock_hz: float  # of the gait's clock in it


def by_policy(policy: Policy, name: str = "") -> Walker:
    """A policy that was learned.

    Args:
        policy: to take home.
        name: what it is called beside its damage; empty: the method that it was learned by.

    Raises:
        ValueError: it is for another robot or a task that this robot has not, or reads another observation.
    """
    about = policy.about
    if about.get("robot", PHANTOMX.name) != PHANTOMX.name:
        raise ValueError(f"policy is for robot {about['robot']!r}: this one is the {PHANTOMX.name}.")
    task, kind = about.get("task"), about.get("kind")
    if task not in TASKS or kind not in KINDS:
        raise ValueError(
            f"policy is for task {task!r} by the observation {kind!r}: this robot has {', '.join(TASKS)} and gives "
            f"{', '.join(KINDS)}."
        )
    size = sum(size for _, size in layout(task, kind))
    if policy.observation_size != size:
        raise ValueError(
            f"policy reads {policy.observation_size} numbers: this robot's observation {kind} for {task} has {size}."
        )
    return Walker(f"{name or about['method']} for {about['damage']}", policy, task, kind, float(about["clock_hz"]))


def tripod(task: str, clock_hz: float | None = None, kind: Kind = "onboard") -> Walker:
    """pi_B, the scripted gait of the healthy robot.

    Args:
        task: x, xy or p2p.
        clock_hz: of the clock that it is shown; None: its own.
        kind: of the observation, of which it reads the beginning.
    """
    gait = gaits.load()
    act = jax.jit(lambda observation: gaits.act(gait, observation))
    own = float(gait.frequency)
    return Walker("tripod", lambda observation: np.asarray(act(observation)), task, kind, clock_hz or own)
