"""Files of named arrays, compressed and without pickle: all of a file is written or nothing of it."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

# What reading such a file, and taking it apart, may end in.
UNREADABLE = (OSError, KeyError, ValueError, EOFError, AttributeError, IndexError, TypeError, zipfile.BadZipFile)


@contextmanager
def reading(path: Path, what: str, made_by: str) -> Iterator[None]:
    """What goes wrong within is said in one sentence.

    Args:
        path: of the file.
        what: it should hold, such as "an atlas".
        made_by: the command that makes one.

    Raises:
        ValueError: there is no such file, or it does not hold that.
    """
    try:
        yield
    except FileNotFoundError:
        raise ValueError(f"{path} does not exist: make {what} with python -m srl_jax.{made_by}.") from None
    except UNREADABLE as error:
        raise ValueError(f"{path} cannot be read as {what} ({type(error).__name__}).") from error


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
