"""The files of a run as plain data: `lanes.csv`, `metrics.csv` and `config.json`.

Metrics have prefixes: ``eval/`` (the student alone), ``teacher/`` (the lane's pi_B under its damage, once per stage of
a schedule), ``healthy/`` (the lane's pi_B on the healthy robot), ``reference/`` (the tuned tripod on the healthy robot,
the same for every method), ``train/`` (means since the last evaluation), ``gauge/`` (last values of running totals).
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from srl_jax.statistics import FloatArray

FILES = ("lanes.csv", "metrics.csv", "config.json")
METRICS_HEADER = ("step", "lane", "metric", "value")
ROWS_AT_ONCE = 1 << 18  # of metrics.csv, so that a long file is never held as text


class Lane(TypedDict):
    """One row of `lanes.csv`."""

    lane: int
    algo: str
    seed: int
    task: str
    damage: str
    variant: str


class Recorded(NamedTuple):
    """One metric of all lanes; columns are in the order of `RunData.lanes`."""

    steps: NDArray[np.int64]  # [T], increasing
    values: FloatArray  # [T, L], NaN where a lane was non-finite or has no row
    written: NDArray[np.bool_]  # [T, L], whether there is a row


def read_lanes(directory: Path) -> list[Lane]:
    """The rows of `lanes.csv`.

    Raises:
        ValueError: the directory is no run's, or the file lacks a column.
    """
    for name in FILES:
        if not (directory / name).is_file():
            raise ValueError(f"{directory} is not the directory of a run: it has no {name}.")
    rows = read_rows(directory / "lanes.csv", *Lane.__annotations__)
    return [Lane(lane=int(i), algo=a, seed=int(s), task=t, damage=d, variant=v) for i, a, s, t, d, v in rows]


def read_settings(directory: Path) -> dict[str, Any]:
    """Every setting of a run as plain JSON, sections included: no class of this version has to understand it."""
    return json.loads((directory / "config.json").read_text()).get("config", {})


def episodes(settings: Mapping[str, Any]) -> int:
    """Episodes of one evaluation, by the settings of a run."""
    return int(settings.get("evaluation", {}).get("episodes", settings["train"]["environments"]))


def read_rows(path: Path, *columns: str) -> Iterator[tuple[str, ...]]:
    """The named columns of a CSV file, row by row; a half-written last line is dropped.

    Raises:
        ValueError: a column is missing, or a row is too short.
    """
    with path.open(newline="") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))
        header = next(reader, [])
        if absent := [column for column in columns if column not in header]:
            raise ValueError(f"{path.name} lacks column {', '.join(absent)}; it has {', '.join(header)}.")
        try:
            yield from map(itemgetter(*(header.index(column) for column in columns)), reader)
        except IndexError:
            raise ValueError(f"{path}, line {reader.line_num}, has fewer columns than its header.") from None


def read_recorded(path: Path, lanes: Sequence[Lane]) -> dict[str, Recorded]:
    """The metrics of some lanes; of a (step, lane, metric) that is repeated the last value stays.

    Args:
        path: of metrics.csv; columns are converted whole, for a run of thousands of lanes has millions of rows.
        lanes: whose rows are kept.

    Raises:
        ValueError: a column is missing, or a row is too short.
    """
    known = np.array(sorted(lane["lane"] for lane in lanes))
    place = np.argsort([lane["lane"] for lane in lanes])
    found: dict[str, list[NDArray[Any]]] = {}
    rows = read_rows(path, *METRICS_HEADER)
    while part := list(islice(rows, ROWS_AT_ONCE)):
        steps, ids, names, values = zip(*part, strict=True)
        codes = {name: code for code, name in enumerate(dict.fromkeys(names))}
        code = np.fromiter(map(codes.__getitem__, names), np.int64)
        lane = np.fromiter(map(int, ids), np.int64)
        column = np.searchsorted(known, lane).clip(max=len(known) - 1)
        own = known[column] == lane
        numbers = np.stack([np.fromiter(map(int, steps), float), place[column], np.fromiter(map(float, values), float)])
        for name, number in codes.items():
            found.setdefault(name, []).append(numbers[:, own & (code == number)])
    tables = {name: _table(np.concatenate(parts, axis=1), len(lanes)) for name, parts in found.items()}
    return {name: table for name, table in tables.items() if len(table.steps)}


def _table(rows: FloatArray, lanes: int) -> Recorded:
    # Of f64[3, N]: steps, columns and values. An assignment to the same place twice leaves the second.
    steps, row = np.unique(rows[0].astype(np.int64), return_inverse=True)
    values, written = np.full((len(steps), lanes), np.nan), np.zeros((len(steps), lanes), bool)
    column = rows[1].astype(np.int64)
    values[row, column], written[row, column] = rows[2], True
    return Recorded(steps, values, written)
