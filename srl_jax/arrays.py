"""Files of named arrays, compressed and without pickle: all of a file is written or nothing of it."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

UNREADABLE = (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile)  # what reading such a file may end in


def save(path: Path, **arrays: Any) -> None:
    """Writes an .npz, whatever the path's suffix."""
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, **arrays)
    partial.replace(path)


def load(path: Path) -> dict[str, Any]:
    """All arrays of a file.

    Raises:
        FileNotFoundError: there is none.
        OSError, ValueError, EOFError, BadZipFile: it is not such a file, or a part of one.
    """
    with path.open("rb") as file, np.load(file) as stored:
        return {name: stored[name] for name in stored.files}
