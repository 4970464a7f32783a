"""The lane table: which algorithm x seed x damage x variant a row of the arrays is, and how rows lie over devices.

This module imports no jax, so that lanes can be counted before devices are set up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

MIX = "mix"  # the damage of a lane whose robots carry different ones
Variant = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Lane:
    """One independent training run."""

    index: int
    algo: str
    seed: int
    task: str
    damage: str
    variant: Variant = ()

    @property
    def label(self) -> str:
        """Swept hyper-parameters as text, empty where none is swept."""
        return " ".join(f"{name}={value:g}" for name, value in self.variant)

    @property
    def method(self) -> str:
        """Algorithm and variant: what lanes share that differ by seed and damage only."""
        return f"{self.algo} {self.label}".strip()


@dataclass(frozen=True)
class Layout:
    """Lanes laid over devices: every device holds `counts` rows of each algorithm, padded to equal numbers.

    Arrays over all rows are device-major, then algorithm-major; arrays of one algorithm are device-major.
    """

    devices: int
    counts: tuple[tuple[str, int], ...]  # (algorithm, rows per device)
    rows: tuple[Lane, ...]  # every row of the program, padding included
    padding: tuple[bool, ...]  # rows that only fill up; their results are dropped

    @property
    def algos(self) -> tuple[str, ...]:
        """The algorithms, in the order of their rows on a device."""
        return tuple(algo for algo, _ in self.counts)

    def of(self, algo: str) -> tuple[Lane, ...]:
        """The rows of one algorithm, in the order of that algorithm's arrays."""
        return tuple(self.rows[i] for i in self.rows_of[algo])

    @cached_property
    def rows_of(self) -> dict[str, np.ndarray]:
        """Where each algorithm's rows lie among all rows: algorithm -> i[n]."""
        names = np.array([lane.algo for lane in self.rows])
        return {algo: np.flatnonzero(names == algo) for algo in self.algos}

    @cached_property
    def lanes(self) -> np.ndarray:
        """The index of every row's lane, i[R]; -1 for padding."""
        return np.array([-1 if pad else row.index for row, pad in zip(self.rows, self.padding, strict=True)])

    def slices(self) -> dict[str, slice]:
        """Where each algorithm's rows lie among the rows of one device."""
        result, start = {}, 0
        for algo, count in self.counts:
            result[algo] = slice(start, start + count)
            start += count
        return result


def lay_out(lanes: Sequence[Lane], devices: int, room: Mapping[str, int] = MappingProxyType({})) -> Layout:
    """Splits each algorithm's lanes evenly over the devices; the last lane fills up what does not divide.

    Args:
        lanes: at least one of each algorithm.
        devices: how many.
        room: rows of an algorithm, at least, where its part of a run shall be as large as the other parts.
    """
    own: dict[str, list[Lane]] = {}
    for lane in lanes:
        own.setdefault(lane.algo, []).append(lane)
    shares: list[list[tuple[Lane, bool]]] = [[] for _ in range(devices)]
    counts = []
    for algo, rows in own.items():
        count = -(-max(len(rows), room.get(algo, 0)) // devices)
        padded = [(lane, False) for lane in rows] + [(rows[-1], True)] * (count * devices - len(rows))
        for device in range(devices):
            shares[device] += padded[device * count : (device + 1) * count]
        counts.append((algo, count))
    flat = [entry for share in shares for entry in share]
    return Layout(
        devices=devices,
        counts=tuple(counts),
        rows=tuple(lane for lane, _ in flat),
        padding=tuple(pad for _, pad in flat),
    )


def moved(old: Sequence[int], new: Sequence[Lane]) -> np.ndarray:
    """For each new row, the old row of the same lane: i[n].

    Args:
        old: lane index of each old row; of a lane's several rows (padding) the first counts.
        new: the rows of another layout.

    Raises:
        ValueError: a lane is not among the old ones.
    """
    place = {lane: row for row, lane in reversed(list(enumerate(old)))}
    missing = sorted({lane.index for lane in new} - place.keys())
    if missing:
        raise ValueError(f"lanes {missing[:5]} are not among those that were stored.")
    return np.array([place[lane.index] for lane in new])
