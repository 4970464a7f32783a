"""What a sweep consists of: points of a grid of settings, each split into packs of lanes of equal shape.

A pack is a part of the run that a point describes (`Config.part`), so it is an ordinary run that resumes and that
anybody can do again by hand. The manifest says so for all of them, and is written once. No jax is imported here.
"""

import dataclasses
import itertools
import json
import shlex
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from srl_jax.config import Config
from srl_jax.job import files, plan

NAME = "sweep.json"


@dataclass(frozen=True)
class Point:
    """One combination of the grid: what a run of all its lanes would be told, and in how many parts it is done."""

    label: str  # of the grid's settings, empty where there is no grid
    arguments: tuple[str, ...]  # of `srl-jax run`
    config: Config
    parts: int = 1

    @cached_property
    def lanes(self) -> dict[str, int]:
        """How many lanes each algorithm has, none of which is made."""
        return plan.counts(self.config)


@dataclass(frozen=True)
class Pack:
    """The lanes of one task."""

    number: int
    directory: Path
    config: Config
    arguments: tuple[str, ...]
    task: Path  # where its lease and attempts are recorded

    @property
    def done(self) -> bool:
        """Whether it has been trained: only curves and page are written after the summary."""
        return (self.directory / "summary.json").exists()

    @property
    def command(self) -> str:
        """What does the same by hand."""
        return shlex.join(["srl-jax", "run", *self.arguments, "--out", str(self.directory)])


@dataclass(frozen=True)
class Sweep:
    """All packs of a sweep; they are numbered from point to point and made one at a time."""

    directory: Path
    points: tuple[Point, ...]
    engine: dict[str, Any] = field(default_factory=dict)  # options with which it is resumed where no others are given

    @cached_property
    def _ends(self) -> list[int]:
        return list(itertools.accumulate(point.parts for point in self.points))

    def __len__(self) -> int:
        return self._ends[-1]

    def pack(self, number: int) -> Pack:
        """The pack of a number.

        Raises:
            ValueError: there is none.
        """
        if not 0 <= number < len(self):
            raise ValueError(f"run-pack is {number}: this sweep has the packs 0 to {len(self) - 1}.")
        place = self.point_of(number)
        point, first = self.points[place], self._ends[place] - self.points[place].parts
        part = f"{number - first + 1}/{point.parts}"
        config = dataclasses.replace(point.config, part=part)
        folder, task = (self.directory / kind / f"{number:05d}" for kind in ("packs", "tasks"))
        return Pack(number, folder, config, (*point.arguments, "--part", part), task)

    def packs(self) -> Iterator[Pack]:
        """Every pack."""
        return map(self.pack, range(len(self)))

    def unfinished(self) -> list[int]:
        """The numbers of the packs that are not done."""
        return [pack.number for pack in self.packs() if not pack.done]

    def point_of(self, number: int) -> int:
        """The place of a pack's point in the grid; its packs share one program."""
        return bisect_right(self._ends, number)


def split(points: Sequence[Point], pack_lanes: int) -> tuple[Point, ...]:
    """The points in parts of at most so many lanes, as equal as can be.

    Raises:
        ValueError: no lane would be in a pack, or an algorithm has fewer lanes than there would be packs.
    """
    if pack_lanes < 1:
        raise ValueError(f"pack_lanes is {pack_lanes}: at least 1 lane has to be in a pack.")
    done = []
    for point in points:
        total, least = sum(point.lanes.values()), min(point.lanes.values())
        parts = -(-total // pack_lanes)
        if parts > least:
            few = min(point.lanes, key=lambda algo: point.lanes[algo])
            raise ValueError(
                f"pack_lanes is {pack_lanes}: that makes {parts} packs, but {few} has {least} of {total} lanes and "
                f"every pack needs one; give at least {-(-total // least)}, or sweep the algorithms apart "
                "(--grid algos=...)."
            )
        done.append(dataclasses.replace(point, parts=parts))
    return tuple(done)


def write(sweep: Sweep) -> None:
    """sweep.json, once: all of it or nothing.

    Raises:
        ValueError: there is one already, of another sweep; the message names a field in which they differ.
    """
    path = sweep.directory / NAME
    if path.exists():
        return refuse_other(read(sweep.directory), sweep)
    files.check_empty(sweep.directory)
    sweep.directory.mkdir(parents=True, exist_ok=True)
    points = [
        {
            "label": point.label,
            "arguments": list(point.arguments),
            "config": dataclasses.asdict(point.config),
            "lanes": point.lanes,
            "parts": point.parts,
        }
        for point in sweep.points
    ]
    packs = {f"{pack.number:05d}": pack.command for pack in sweep.packs()}
    files.write_json(path, {"engine": sweep.engine, "points": points, "packs": packs})


def read(directory: Path) -> Sweep:
    """The sweep of a directory.

    Raises:
        ValueError: the directory is no sweep's, or was written by another version.
    """
    path = directory / NAME
    try:
        stored: dict[str, Any] = json.loads(path.read_text())
        points = [
            Point(x["label"], tuple(x["arguments"]), files.config_of(x["config"], path), int(x["parts"]))
            for x in stored["points"]
        ]
        engine = dict(stored["engine"])
    except FileNotFoundError:
        raise ValueError(f"{directory} is not the directory of a sweep: it has no {NAME}.") from None
    except (LookupError, TypeError, ValueError) as error:
        raise ValueError(f"{path} cannot be read as a sweep of this version: {error}") from error
    return Sweep(directory, tuple(points), engine)


def refuse_other(old: Sweep, new: Sweep) -> None:
    """Raises ValueError where a directory's sweep is not the one that is asked for, naming what differs."""
    changed: list[str] = []
    if [point.label for point in old.points] != [point.label for point in new.points]:
        changed.append("grid")
    for before, after in zip(old.points, new.points, strict=False):
        changed += files.differences(vars(before.config), vars(after.config))
        changed += ["pack_lanes"] if before.parts != after.parts else []
    if changed:
        raise ValueError(
            f"out is {old.directory}: it holds another sweep, which differs in {', '.join(dict.fromkeys(changed))}; "
            "choose another directory, or go on with --resume alone."
        )
