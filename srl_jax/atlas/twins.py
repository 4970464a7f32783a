"""Damages that nobody foresaw, put together by the robot itself, and the policies that it has learned for them.

Damage is a value, so a hypothesis can be added while the robot walks: once servos stay silent in a pattern that no
admitted hypothesis has, or it is none of these for a second (`suspects`). Then all policies walk in its simulation:
what the matrix would have said of it, had anybody asked before. It costs no robot time and a fraction of a second of
computing; a few seconds more, and there is a policy that was trained for it (`lessons`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from srl_jax.atlas import suspects
from srl_jax.atlas.suspects import Log, Recorder
from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env.damage import Damage
from srl_jax.env.senses import Senses
from srl_jax.types import Params

ROOM = 3  # damages that a robot can put together
PATIENCE = 4  # control steps that a silence must last: lost packets do not
AGAIN = 80  # control steps between two searches, while it is none of these


class Twins(NamedTuple):
    """What a robot has added to its atlas: S hypotheses at most, and a policy for each."""

    damage: Damage  # leaves [S, ...]; the healthy robot's where there is none yet
    value: np.ndarray  # f32[I, S] what the atlas' policies are worth under them
    admitted: np.ndarray  # bool[S]
    actors: Params  # leaves [S, ...] learned for each, as far as it goes
    mastery: np.ndarray  # f32[S] what these are worth under the damage that they were learned for
    graduated: np.ndarray  # bool[S]
    revised: np.ndarray  # i32[] the hypothesis of D + S about which it has thought again; -1: none
    revision: np.ndarray  # f32[I + S] what all policies are worth under that one, from where it is


def nobody(value: np.ndarray, actors: Params) -> Twins:
    """None yet; as good as an average damage of the matrix f32[I, D], so that they say nothing."""
    return Twins(
        damage=damages.stack([damage_names.HEALTHY] * ROOM),
        value=np.repeat(value.mean(axis=1, keepdims=True), ROOM, axis=1),
        admitted=np.zeros(ROOM, bool),
        actors=jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf[:1]), ROOM, axis=0), actors),
        mastery=np.zeros(ROOM, np.float32),
        graduated=np.zeros(ROOM, bool),
        revised=np.array(-1),
        revision=np.zeros(len(value) + ROOM, np.float32),
    )


def put(old: Any, slot: int, new: Any) -> np.ndarray:
    """An array with another row."""
    return np.concatenate([old[:slot], np.asarray(new, old.dtype)[None], old[slot + 1 :]])


@dataclass
class Composer:
    """Watches N robots and adds hypotheses; what was imagined for one serves all."""

    names: Sequence[str]  # of the atlas' damages
    imagine: Callable[[Damage], np.ndarray]  # an unbatched damage -> what the policies are worth, f32[I]
    explain: Callable[[Damage, Log], np.ndarray]  # damages [ROOM, ...] and a log -> log-likelihoods
    twins: list[Twins]  # of every robot
    made: dict[str, tuple[Damage, np.ndarray]] = field(default_factory=dict)
    added: list[list[str]] = field(init=False)  # names of every robot's twins
    unsure: set[int] = field(default_factory=set)  # robots that are to think again, whatever comes of their walking
    _silent: list[tuple[str | None, int]] = field(init=False)
    _recorders: list[Recorder] = field(init=False)
    _strange: list[int] = field(init=False)  # control steps for which it was none of these

    def __post_init__(self) -> None:
        self.added, self._silent = [[] for _ in self.twins], [(None, 0) for _ in self.twins]
        self._recorders, self._strange = [Recorder() for _ in self.twins], [0 for _ in self.twins]

    def listen(self, robot: int, answering: np.ndarray, admitted: np.ndarray) -> None:
        """One control step of a robot that has these servos, bool[18], and may use these damages, bool[D]."""
        name = suspects.composed(answering)
        before, lasted = self._silent[robot]
        self._silent[robot] = (name, lasted + 1 if name == before else 1)
        if name is not None and self._silent[robot][1] >= PATIENCE:
            self._add(robot, name, admitted)

    def doubt(self, robot: int, action: np.ndarray, felt: Senses, strange: bool, admitted: np.ndarray) -> None:
        """The same, once it has acted and felt; `strange` says whether it is likely none of the hypotheses."""
        recorder = self._recorders[robot]
        recorder.add(action, felt)
        self._strange[robot] = self._strange[robot] + 1 if strange else 0
        if self._strange[robot] % AGAIN != suspects.STEPS or not recorder.full or len(self.added[robot]) == ROOM:
            return
        log = recorder.log()
        name = suspects.search(lambda damage: np.asarray(self.explain(damage, log)), log)
        if name is not None:
            self._add(robot, name, admitted)

    def revise(self, robot: int, hypothesis: Any, worth: Any) -> None:
        """What policies f32[I + S] are worth under one of D + S hypotheses from where the robot is."""
        self.unsure.discard(robot)
        own = self.twins[robot]
        self.twins[robot] = own._replace(revised=np.array(hypothesis), revision=np.array(worth, np.float32))

    def _add(self, robot: int, name: str, admitted: np.ndarray) -> None:
        known = {own for own, may in zip(self.names, admitted, strict=True) if may}
        if name in known or name in self.added[robot] or len(self.added[robot]) == ROOM:
            return
        if name not in self.made:
            damage = damages.build(name)
            self.made[name] = damage, np.asarray(self.imagine(damage))
        slot, twins = len(self.added[robot]), self.twins[robot]
        damage, worth = self.made[name]
        self.twins[robot] = twins._replace(
            damage=jax.tree.map(lambda old, new: put(old, slot, new), twins.damage, damage),
            value=put(twins.value.T, slot, worth).T,
            admitted=np.arange(ROOM) <= slot,
        )
        self.added[robot].append(name)
