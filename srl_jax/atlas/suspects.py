"""Damages that nobody foresaw and no servo tells of: faults are added while they explain better what was felt.

Damage is a value, so every supposition is a simulated robot: it is led along the last seconds of walking and judged as
hypotheses are (`tracking`, `belief`). To what the silence of servos says, one fault is added after the other, as in
matching pursuit, while each makes what was felt likelier by more than it costs to suppose it.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import jax
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import damage_names, senses
from srl_jax.env.anatomy import JOINTS, LEGS, SEGMENTS
from srl_jax.env.damage import Damage
from srl_jax.env.senses import Senses

STEPS = 40  # control steps that are explained: two seconds
LEAD_IN = 10  # of them, until a supposed robot is where the real one is, that do not count
MOST = 3  # faults
PRICE = 8.0  # nats by which a fault must make the rest likelier
WEAK, SHORT = (0.25, 0.5), 0.6  # shares that are supposed
COARSE = 5.0  # degrees to which the angle of a lock is rounded
ROOM = 96  # suppositions that are judged at once


class Log(NamedTuple):
    """The last control steps: leaves [STEPS, ...]."""

    action: np.ndarray  # f32[T, 18] taken
    felt: np.ndarray  # f32[T, 24] after it
    answering: np.ndarray  # bool[T, 18]


@dataclass
class Recorder:
    """Keeps the log of one robot."""

    rows: deque[tuple[np.ndarray, Senses]] = field(default_factory=lambda: deque(maxlen=STEPS))

    def add(self, action: np.ndarray, felt: Senses) -> None:
        """One control step: what was done, and what was felt then."""
        self.rows.append((action, felt))

    @property
    def full(self) -> bool:
        return len(self.rows) == STEPS

    def log(self) -> Log:
        action, felt = jax.tree.map(lambda *leaves: np.stack(leaves), *self.rows)
        return Log(action, np.asarray(senses.felt(felt)), felt.answering)


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


def supposed(base: str, answering: np.ndarray, angles: np.ndarray) -> list[str]:
    """`base` with one more fault of a servo that answers and has none yet.

    Args:
        base: name of a damage.
        answering: bool[18].
        angles: f32[18] rad about the stance, at which a joint may have locked.
    """
    faulty = {joint for loss in damage_names.parse(base) for joint in loss.joints}
    names = []
    for joint, alive, angle in zip(JOINTS, answering, np.degrees(angles), strict=True):
        if not alive or joint in faulty:
            continue
        lock = float(np.clip(COARSE * np.round(angle / COARSE), -damage_names.LOCKS, damage_names.LOCKS))
        kinds = ["limp", f"locked={lock:g}", *(f"weak={share:g}" for share in WEAK)]
        kinds += [f"short={SHORT:g}"] if joint.startswith("tibia") else []
        before = [] if base == damage_names.HEALTHY else [base]
        names += [damage_names.canonical("+".join([*before, f"{joint}:{kind}"])) for kind in kinds]
    return names


def search(judge: Callable[[Damage], np.ndarray], log: Log) -> str | None:
    """The damage that explains a log best; None where healthy does, or nothing that was supposed does any better.

    Args:
        judge: log-likelihoods f32[ROOM] of the log under damages, leaves [ROOM, ...].
        log: what was done and felt.
    """
    answering = np.mean(log.answering, axis=0) > 0.5
    angles = np.median(log.felt[-LEAD_IN:, senses.ANGLES], axis=0)
    best = composed(answering) or damage_names.HEALTHY
    likelihood = judge(_stacked([best]))[0]
    for _ in range(MOST):
        names = supposed(best, answering, angles)
        if not names:
            break
        found = judge(_stacked(names))[: len(names)]
        if found.max() - likelihood < PRICE:
            break
        best, likelihood = names[int(np.argmax(found))], found.max()
    return None if best == damage_names.HEALTHY else best


def _stacked(names: Sequence[str]) -> Damage:
    """So many damages, filled up to `ROOM` by the last."""
    built = [_built(name) for name in [*names, *[names[-1]] * (ROOM - len(names))]]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *built)


@cache
def _built(name: str) -> Damage:
    return damages.build(name)
