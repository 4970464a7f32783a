"""What a walk leaves: a line of JSON a control step, written as it comes, from which the walk can be computed again."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srl_jax.env.senses import Senses
from srl_jax.portable import Policy
from srl_jax.robot.hexapod import PERIOD, Sensed
from srl_jax.robot.policy import Walker
from srl_jax.robot.servo import STANDING, Calibration, Servos


class Entry(NamedTuple):
    """One control step."""

    time: float  # s since the start, when its goals were sent
    late: float  # s after its deadline
    phase: float
    joints: list[float]  # rad about the stance, and so on as `Senses` has them
    speeds: list[float]
    answering: list[bool]
    gyroscope: list[float]
    gravity: list[float]
    towards: list[float]
    angles: list[float]  # rad, that commands are near to
    action: list[float]
    goals: list[int]  # steps
    missed: int
    voltage: float
    temperature: int


def entry(time: float, late: float, phase: float, sensed: Sensed, action: np.ndarray, goals: np.ndarray) -> Entry:
    """The entry of a step."""
    own: Senses = sensed.senses
    each = {name: getattr(own, name) for name in ("joints", "speeds", "answering", "gyroscope", "gravity", "towards")}
    each |= {"angles": sensed.angles, "action": action, "goals": goals}
    lists = {name: np.asarray(value).tolist() for name, value in each.items()}
    single = {name: getattr(sensed, name) for name in ("missed", "voltage", "temperature")}
    return Entry(time=time, late=late, phase=phase, **lists, **single)


class Writer:
    """A file that grows by a line a step; what was written stays should the program be killed."""

    def __init__(self, path: Path, about: dict[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("w", buffering=1)
        self._file.write(json.dumps(about) + "\n")

    def add(self, step: Entry) -> None:
        """One line more."""
        self._file.write(json.dumps(step) + "\n")

    def close(self) -> None:
        """No more come."""
        self._file.close()


def read(path: Path) -> tuple[dict[str, Any], list[Entry]]:
    """What the walk was, and its steps; a last line that was broken off is left out.

    Raises:
        ValueError: there is no such file, or it is no log.
    """
    try:
        first, *rest = path.read_text().splitlines(keepends=True)
        about = json.loads(first)
        steps = [Entry(*json.loads(text)) for text in rest if text.endswith("\n")]
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"log is {path}: it is no log of a walk ({error}).") from None
    return about, steps


def replay(steps: list[Entry], policy: Policy, calibration: Calibration) -> Iterator[tuple[float, int]]:
    """For every step, how far its action and its goal positions (steps) are from those that are computed again.

    A policy that was exchanged in mid-walk shows as a difference.
    """
    walker, servos = Walker(policy), Servos()
    before = 0.0  # s, the last deadline
    for step in steps:
        deadline = step.time - step.late
        walker.advance(max(round((deadline - before) / PERIOD), 1))
        walker.phase, before = step.phase, deadline
        single = lambda values: np.asarray(values, np.float32)  # noqa: E731
        senses = Senses(
            *(single(step.joints), single(step.speeds), np.array(step.answering)),
            *(single(step.gyroscope), single(step.gravity), single(step.towards)),
            *(single(2.0), single(np.nan)),
        )
        _, action = walker.act(senses)
        wanted = STANDING + walker.offsets(action)
        goals = calibration.steps(servos.command(wanted, np.array(step.angles), np.array(step.speeds), PERIOD))
        yield float(np.abs(action - step.action).max()), int(np.abs(goals - step.goals).max())
