"""The files of a search for a repertoire: its checkpoint and its metrics."""

import csv
import dataclasses
from pathlib import Path

import numpy as np

from srl_jax import arrays
from srl_jax.ite import elites
from srl_jax.ite.elites import Archive
from srl_jax.job.files import replaced

METRICS = ("evaluations", "filled", "best_fitness", "mean_fitness", "qd_score", "killed")


@dataclasses.dataclass
class Search:
    """All that a checkpoint holds."""

    archive: Archive
    history: np.ndarray  # f64[generations, METRICS]
    seconds: float  # spent searching, earlier processes included


def beginning() -> Search:
    """A search that has not begun."""
    return Search(elites.empty(), np.zeros((0, len(METRICS))), 0.0)


def write_metrics(path: Path, history: np.ndarray) -> None:
    """metrics.csv: one row a generation; all of it or nothing."""
    with replaced(path) as file:
        writer = csv.writer(file)
        writer.writerow(METRICS)
        writer.writerows([f"{value:.7g}" for value in row] for row in history)


def write_checkpoint(path: Path, search: Search) -> None:
    """The whole search in one file."""
    found = {name: np.asarray(value) for name, value in search.archive._asdict().items()}
    arrays.save(path, **found, history=search.history, seconds=np.array(search.seconds))


def read_checkpoint(path: Path) -> Search | None:
    """What `write_checkpoint` wrote; None where there is no file yet.

    Raises:
        ValueError: the file cannot be read.
    """
    if not path.exists():
        return None
    try:
        found = arrays.load(path)
        archive = Archive(*(found[name] for name in Archive._fields))
        search = Search(archive, found["history"], float(found["seconds"]))
    except arrays.UNREADABLE as error:
        raise ValueError(
            f"{path} cannot be read ({type(error).__name__}); remove it to start again, or restore it from a copy."
        ) from error
    if [x.shape for x in archive] != [x.shape for x in elites.empty()] or search.history.shape[1:] != (len(METRICS),):
        raise ValueError(f"{path} is of another version; remove it to start again.")
    return search
