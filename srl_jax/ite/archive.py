"""The file of a repertoire: its elites, small enough to ship whole, and how they were made.

A full map of 15,625 cells is 0.7 MB before compression, so nothing is thinned out: genes are levels (one byte each),
descriptors are counts of the 100 control steps (one byte each), and both are exact.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax import arrays
from srl_jax.ite import elites
from srl_jax.ite.elites import DIMENSIONS, LEVELS, Archive
from srl_jax.ite.family import GENES
from srl_jax.ite.walk import STEPS

DATA = Path(__file__).with_name("repertoire.npz")


class Repertoire(NamedTuple):
    """The N filled cells of a map, in the order of cells."""

    gaits: jax.Array  # f32[N, 36] parameters for `family.action`, in [0, 1]
    fitness: jax.Array  # f32[N] m walked along x in 5 s
    descriptors: jax.Array  # f32[N, 6] duty factor of each foot, legs rf rm rr lf lm lr
    about: dict[str, Any]  # settings and figures of the search: clock_hz, damage, seed, evaluations, ...


def save(path: Path, archive: Archive, about: dict[str, Any]) -> None:
    """Writes an archive's filled cells, all of the file or nothing of it; `about` must be fit for JSON."""
    filled = np.isfinite(archive.fitness)
    arrays.save(
        path,
        genes=np.asarray(archive.genes)[filled],
        fitness=np.asarray(archive.fitness, np.float32)[filled],
        contacts=np.rint(STEPS * np.asarray(archive.descriptors)[filled]).astype(np.uint8),
        about=np.array(json.dumps(about)),
    )


def load(path: str | Path = "") -> Repertoire:
    """The repertoire in a file, or the one that ships with the package where `path` is empty.

    Raises:
        ValueError: there is no such file, or it is no repertoire.
    """
    path = Path(path) if path else DATA
    with arrays.reading(path, "a repertoire", "repertoire"):
        found = arrays.load(path)
        genes, fitness, contacts = found["genes"], found["fitness"], found["contacts"]
        about = json.loads(str(found["about"]))
    count = len(genes)
    shapes = [x.shape for x in (genes, fitness, contacts)]
    if shapes != [(count, GENES), (count,), (count, DIMENSIONS)] or not count:
        raise ValueError(f"{path} is no repertoire of this version: its arrays have shapes {shapes}.")
    if genes.max() >= LEVELS or contacts.max() > STEPS or not np.isfinite(fitness).all():
        raise ValueError(f"{path} is damaged: genes, contacts or fitness are out of range.")
    return Repertoire(
        gaits=elites.gaits(jnp.asarray(genes)),
        fitness=jnp.asarray(fitness, jnp.float32),
        descriptors=jnp.asarray(contacts, jnp.float32) / STEPS,
        about=about,
    )
