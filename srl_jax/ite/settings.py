"""What a search for a repertoire is. This module imports no jax, so that ``--help`` answers at once."""

import json
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RepertoireSettings:
    """A search for a repertoire of gaits by MAP-Elites (Cully et al. 2015)."""

    evaluations: int = 200_000
    """Gaits to walk in all, 5 s each; they are walked in whole batches."""
    batch: int = 1024
    """Gaits of a generation, walked at once: a multiple of the devices, and of 64 a device on a CPU to be fast."""
    seed: int = 0
    """Of all randomness; with the batch it decides the result, on one kind and number of devices."""
    damage: str = "healthy"
    """Of the robot that walks: a name such as leg_rm; a repertoire is usually made before any damage."""
    clock_hz: float = 1.0
    """Cycles of a gait per second; 1 as published."""


def check(settings: RepertoireSettings) -> None:
    """Checks what needs no simulator.

    Raises:
        ValueError: a number is out of range; the message names it.
    """
    for name, lowest, highest in (("evaluations", 1, 2**31), ("batch", 1, 2**20), ("seed", 0, 2**31)):
        value = getattr(settings, name)
        if not lowest <= value < highest:
            raise ValueError(f"{name} is {value}: give a number from {lowest} to {highest - 1}.")
    if not 0.0 < settings.clock_hz <= 10.0:
        raise ValueError(
            f"clock_hz is {settings.clock_hz}: give a frequency above 0 and at most 10, half of control's."
        )


def read_settings(directory: Path) -> RepertoireSettings:
    """The settings of a search.

    Raises:
        ValueError: the directory is no search's.
    """
    path = directory / "config.json"
    try:
        return RepertoireSettings(**json.loads(path.read_text())["repertoire"])
    except FileNotFoundError:
        raise ValueError(f"{directory} is not the directory of a repertoire: it has no config.json.") from None
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} cannot be read as the settings of a repertoire: {error}.") from error
