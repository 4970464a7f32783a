"""The file of an atlas: policies, who walks how well under which damage, and how the senses tell damages apart."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax import arrays
from srl_jax.atlas import stored
from srl_jax.atlas.stored import ACTOR, MEASURED, Atlas


def save(path: Path, atlas: Atlas, *, half: bool = True) -> None:
    """Writes a compressed .npz, all of the file or nothing of it; networks at half precision unless told otherwise."""
    leaves = jax.tree.leaves_with_path(atlas.actors)
    names = ["/".join((ACTOR, *(str(key.key) for key in keys))) for keys, _ in leaves]
    kept = np.float16 if half else np.float32
    networks = {name: np.asarray(leaf, kept) for name, (_, leaf) in zip(names, leaves, strict=True)}
    measured = {name: np.asarray(getattr(atlas, name), np.float32) for name in MEASURED}
    about = atlas.about | {"damages": atlas.damages, "trained_for": atlas.trained_for}
    arrays.save(path, about=np.array(json.dumps(about)), **measured, **networks)


def load(path: str | Path = "") -> Atlas:
    """The atlas in a file, or the one that ships with the package, its policies as arrays of jax.

    Raises:
        ValueError: as `stored.read`.
    """
    found = stored.read(path)
    return found._replace(actors=jax.tree.map(jnp.asarray, found.actors))
