"""What several atlases do alike: the same robots walked with each, pooled, so that intervals are over atlases too.

    for n in 0 1 2 3 4; do
        python -m experiments.recovery atlas-$n.npz --rows foreseen left-out --out atlas-$n.json
    done
    python -m experiments.atlases atlas-*.json

An atlas of another seed is another training of all its policies. Of each method and window: the interquartile mean over
atlases and robots, its 95 % interval by a bootstrap of atlases within robots (Agarwal et al. 2021), the least and the
most of one atlas, and the share of robots that recovered.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from experiments.recovery import RECOVERED
from srl_jax.cli.ending import leave
from srl_jax.statistics import iqm, probability_of_improvement, stratified_interval


@dataclass(frozen=True)
class Args:
    """Pools what `experiments.recovery --out` has written for several atlases."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]


def main(args: Args) -> None:
    """Prints a table for each row that all files have.

    Raises:
        ValueError: fewer than two files, or they are not of the same robots and windows.
    """
    if len(args.files) < 2:
        raise ValueError(f"files has {len(args.files)}: give what was written for two atlases or more.")
    found = [json.loads(path.read_text()) for path in args.files]
    for path, own in zip(args.files, found, strict=True):
        if own["windows"] != found[0]["windows"]:
            raise ValueError(f"{path} has windows {own['windows']}, {args.files[0]} {found[0]['windows']}: walk alike.")
    for name in found[0]["retained"]:
        if all(name in own["retained"] for own in found):
            _row(name, [own["retained"][name] for own in found], found[0]["windows"])


def _row(name: str, each: list[dict[str, list[list[float]]]], windows: list[list[float]]) -> None:
    print(f"\n{name}: {len(each)} atlases")
    print(f"{'method':<14} " + "".join(f"{f'{a:g}-{b:g} s':<34}" for a, b in windows) + "recovered")
    methods = [method for method in each[0] if all(method in own for own in each)]
    kept = {method: np.array([own[method] for own in each]) for method in methods}  # [atlases, windows, robots]
    for method, shares in kept.items():
        cells = "".join(f"{_cell(shares[:, k]):<34}" for k in range(len(windows)))
        print(f"{method:<14} {cells}{np.mean(shares[:, -1] >= RECOVERED):.2f}")
    for method in methods[1:]:
        p, low, high = probability_of_improvement(kept[methods[0]][:, -1], kept[method][:, -1])
        print(f"  P({methods[0]} > {method}) {p:.2f} [{low:.2f}, {high:.2f}]")


def _cell(shares: np.ndarray) -> str:
    low, high = stratified_interval(shares, iqm)
    alone = [iqm(own) for own in shares]
    return f"{iqm(shares.ravel()):.2f} [{low:.2f}, {high:.2f}], {min(alone):.2f} to {max(alone):.2f}"


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
