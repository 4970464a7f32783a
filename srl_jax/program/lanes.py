"""The lane table: which algorithm x seed x damage x variant a row of the arrays is, and how rows lie over devices."""

import zlib
from dataclasses import dataclass

import jax

from srl_jax.agents.hyper import variants
from srl_jax.config import Config

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
    def rows_per_device(self) -> int:
        return sum(count for _, count in self.counts)

    def of(self, algo: str) -> tuple[Lane, ...]:
        """The rows of one algorithm, in the order of that algorithm's arrays."""
        return tuple(lane for lane in self.rows if lane.algo == algo)

    def slices(self) -> dict[str, slice]:
        """Where each algorithm's rows lie among the rows of one device."""
        result, start = {}, 0
        for algo, count in self.counts:
            result[algo] = slice(start, start + count)
            start += count
        return result


def table(config: Config, seeds: tuple[int, ...], algos: tuple[str, ...], damages: tuple[str, ...]) -> list[Lane]:
    """Every lane of a run, numbered: algorithms, their variants, damages, seeds."""
    keys = [
        (algo, seed, config.task, damage, tuple(variant.items()))
        for algo in algos
        for variant in variants(getattr(config, algo))
        for damage in damages
        for seed in seeds
    ]
    return [Lane(index, *key) for index, key in enumerate(keys)]


def lay_out(lanes: list[Lane], devices: int) -> Layout:
    """Splits each algorithm's lanes evenly over the devices; the last lane fills up what does not divide."""
    algos = list(dict.fromkeys(lane.algo for lane in lanes))
    shares: list[list[tuple[Lane, bool]]] = [[] for _ in range(devices)]
    counts = []
    for algo in algos:
        own = [lane for lane in lanes if lane.algo == algo]
        count = -(-len(own) // devices)
        padded = [(lane, False) for lane in own] + [(own[-1], True)] * (count * devices - len(own))
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


def key(lane: Lane, stream: str) -> jax.Array:
    """A lane's root key for one stream of randomness.

    It depends on seed, task and damage only: lanes that differ in their algorithm share starts and noise, and a lane's
    numbers do not depend on which others run beside it.
    """
    condition = zlib.crc32(f"{lane.task}/{lane.damage}/{stream}".encode())
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(0), lane.seed), condition)
