"""Damages that nobody foresaw, put together by the robot itself: servos fall silent with the links that are lost.

Damage is a value, so a hypothesis can be added while the robot walks. Once a pattern of silence lasts that no admitted
hypothesis has, its damage is built, and all policies walk in its simulation: what the matrix would have said of it, had
anybody asked before. It costs no robot time and a fraction of a second of computing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env.anatomy import LEGS, SEGMENTS
from srl_jax.env.damage import Damage

ROOM = 2  # damages that a robot can put together
PATIENCE = 4  # control steps that a silence must last: lost packets do not


class Twins(NamedTuple):
    """The hypotheses that a robot has added, S of them at most."""

    damage: Damage  # leaves [S, ...]; the healthy robot's where there is none yet
    value: np.ndarray  # f32[I, S] what policies are worth under them
    admitted: np.ndarray  # bool[S]


def nobody(value: np.ndarray) -> Twins:
    """None yet; as good as an average damage of the matrix f32[I, D], so that they say nothing."""
    return Twins(_healthy(), np.repeat(value.mean(axis=1, keepdims=True), ROOM, axis=1), np.zeros(ROOM, bool))


@cache
def _healthy() -> Damage:
    return damages.stack([damage_names.HEALTHY] * ROOM)


def composed(answering: np.ndarray) -> str | None:
    """The loss of links that leaves just these servos bool[18] silent; None where none does, or nothing is silent.

    What hangs on a lost link is lost with it; a servo that is silent before one that answers has another fault.
    """
    parts = []
    for leg, alive in zip(LEGS, np.asarray(answering).reshape(len(LEGS), len(SEGMENTS)), strict=True):
        first = int(np.argmin(alive)) if not alive.all() else len(SEGMENTS)
        if alive[first:].any():
            return None
        if first < len(SEGMENTS):
            parts.append(f"{SEGMENTS[first]}_{leg}")
    return damage_names.canonical("+".join(parts)) if parts else None


@dataclass
class Composer:
    """Watches the servos of N robots and adds hypotheses; what was imagined for one serves all."""

    names: Sequence[str]  # of the atlas' damages
    imagine: Callable[[Damage], np.ndarray]  # an unbatched damage -> what the policies are worth, f32[I]
    twins: list[Twins]  # of every robot
    made: dict[str, tuple[Damage, np.ndarray]] = field(default_factory=dict)
    added: list[list[str]] = field(init=False)  # names of every robot's twins
    _silent: list[tuple[str | None, int]] = field(init=False)

    def __post_init__(self) -> None:
        self.added, self._silent = [[] for _ in self.twins], [(None, 0) for _ in self.twins]

    def watch(self, robot: int, answering: np.ndarray, admitted: np.ndarray) -> None:
        """One control step of a robot that has these servos, bool[18], and may use these damages, bool[D]."""
        name = composed(answering)
        before, lasted = self._silent[robot]
        self._silent[robot] = (name, lasted + 1 if name == before else 1)
        known = {own for own, may in zip(self.names, admitted, strict=True) if may}
        full = len(self.added[robot]) == ROOM
        if name is None or self._silent[robot][1] < PATIENCE or name in known or name in self.added[robot] or full:
            return
        if name not in self.made:
            damage = damages.build(name)
            self.made[name] = damage, np.asarray(self.imagine(damage))
        slot, twins = len(self.added[robot]), self.twins[robot]
        damage, worth = self.made[name]

        def put(old: Any, new: Any) -> np.ndarray:
            return np.concatenate([old[:slot], np.asarray(new)[None], old[slot + 1 :]])

        self.twins[robot] = Twins(
            jax.tree.map(put, twins.damage, damage),
            put(twins.value.T, worth).T.astype(np.float32),
            np.arange(ROOM) <= slot,
        )
        self.added[robot].append(name)
