"""Joins the directories of several runs into one, and refuses those that are not comparable.

Lanes do not depend on what ran beside them, so methods that were trained apart, and parts of one run, may stand in one
table, provided that everything else is equal.
"""

import csv
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from srl_jax.env.anatomy import PHANTOMX
from srl_jax.report.files import FILES, METRICS_HEADER, Lane, episodes, read_lanes, read_rows, read_settings

FREE = ("algos", "seeds", "damage", "part", "memory_gb", "devices")  # settings that move no lane's numbers
SHARED = ("env", "train", "evaluation")  # sections of all lanes; every other section is an algorithm's


def check(directories: Sequence[Path]) -> None:
    """Compares the settings of runs, as they stand in their config.json.

    Runs may differ in their algorithms, in the settings of those of which not both of two have lanes, in memory and
    in devices. A run older than `evaluation.episodes` judged by one episode per training environment.

    Raises:
        ValueError: no run is given, a directory is no run's, two differ in anything else, or both have the same lane.
    """
    if not directories:
        raise ValueError("no run is given: name the directory of one or more.")
    lanes = [read_lanes(Path(directory)) for directory in directories]
    settings = [_comparable(read_settings(Path(directory))) for directory in directories]
    for i, j in itertools.combinations(range(len(directories)), 2):
        compared = {*SHARED, *({lane["algo"] for lane in lanes[i]} & {lane["algo"] for lane in lanes[j]})}
        one, other = (_only(settings[k], compared) for k in (i, j))
        if changed := differences(one, other):
            raise ValueError(f"{directories[j]} differs from {directories[i]} in {', '.join(changed)}: no fair table.")
        if twice := set(map(_condition, lanes[i])) & set(map(_condition, lanes[j])):
            name = " ".join(map(str, filter(None, min(twice))))
            raise ValueError(f"{directories[i]} and {directories[j]} both have the lane {name}: give one of them.")


def join(directories: Sequence[Path], into: Path) -> None:
    """Writes the lanes.csv, metrics.csv and config.json of one run that has the lanes of all.

    Lanes keep their numbers where no two have the same, as the parts of one run do; else they are numbered anew, in
    the order of the directories. Settings are the first run's, with every algorithm and its settings.

    Args:
        directories: of runs; see `check`.
        into: a directory without a run in it; made where missing.

    Raises:
        ValueError: runs are not comparable, or `into` holds one.
    """
    check(directories)
    if any((into / name).exists() for name in FILES):
        raise ValueError(f"{into} already holds a run: join into an empty directory.")
    into.mkdir(parents=True, exist_ok=True)
    lanes = [read_lanes(Path(directory)) for directory in directories]
    old = [lane["lane"] for part in lanes for lane in part]
    new = iter(old if len(set(old)) == len(old) else range(len(old)))
    numbers = [{str(lane["lane"]): next(new) for lane in part} for part in lanes]
    with (into / "lanes.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(Lane.__annotations__))
        table.writeheader()
        for part, number in zip(lanes, numbers, strict=True):
            table.writerows({**lane, "lane": number[str(lane["lane"])]} for lane in part)
    with (into / "metrics.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(METRICS_HEADER)
        for directory, number in zip(directories, numbers, strict=True):
            rows = read_rows(Path(directory) / "metrics.csv", *METRICS_HEADER)
            writer.writerows((s, number[lane], metric, value) for s, lane, metric, value in rows if lane in number)
    _write_config(directories, lanes, into)


def _write_config(directories: Sequence[Path], lanes: Sequence[Sequence[Lane]], into: Path) -> None:
    stored = json.loads((Path(directories[0]) / "config.json").read_text())
    settings: dict[str, Any] = stored["config"]
    settings.setdefault("more", {})
    for directory, part in zip(directories, lanes, strict=True):
        own, algos = read_settings(Path(directory)), {lane["algo"] for lane in part}
        settings |= {name: own[name] for name in algos & own.keys()}
        settings["more"] |= {name: value for name, value in own.get("more", {}).items() if name in algos}
    settings["algos"] = ",".join(dict.fromkeys(lane["algo"] for part in lanes for lane in part))
    (into / "config.json").write_text(json.dumps(stored, indent=2) + "\n")


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Names of the fields, sections included, in which two settings differ or which only one of them has."""
    changed = []
    for name in dict.fromkeys((*old, *new)):
        one, other = old.get(name, {}), new.get(name, {})
        if isinstance(one, Mapping) and isinstance(other, Mapping) and (one or other):
            changed += [f"{name}.{field}" for field in differences(one, other)]
        elif one != other or (name in old) != (name in new):
            changed.append(name)
    return changed


def _comparable(settings: Mapping[str, Any]) -> dict[str, Any]:
    # Algorithms from outside the package stand under `more`; they are compared as its own are.
    apart = {name: value for name, value in settings.items() if name != "more"} | settings.get("more", {})
    apart.setdefault("robot", PHANTOMX.name)  # of runs that knew no other
    return {**apart, "evaluation": {**settings.get("evaluation", {}), "episodes": episodes(settings)}}


def _only(settings: Mapping[str, Any], sections: set[str]) -> dict[str, Any]:
    plain = {name: value for name, value in settings.items() if not isinstance(value, Mapping) and name not in FREE}
    return plain | {name: settings[name] for name in sections & settings.keys()}


def _condition(lane: Lane) -> tuple[str, str, int, str, str]:
    return lane["algo"], lane["variant"], lane["seed"], lane["task"], lane["damage"]
