"""How long a run has still to go: by arithmetic until it learns, then by how fast it has been."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from srl_jax.job.progress import Progress as Status

SEEN = 20.0  # s of learning before its own pace is believed


class Left:
    """Seconds left at each status of a run."""

    def __init__(self, whole: float | None = None, warmup: int = 0, clock: Callable[[], float] = time.monotonic):
        """Begins with the run.

        Args:
            whole: seconds that arithmetic gives the run from its beginning; None: it is not known.
            warmup: environment steps before anything is learned, which go faster than the rest.
            clock: seconds.
        """
        self._whole, self._warmup, self._clock, self._began = whole, warmup, clock, clock()
        self._of: Path | None = None
        self._mark: tuple[int, float] | None = None  # a step after the warm-up, and when it was reached

    def seconds(self, status: "Status") -> float | None:
        """Until the last step, evaluations included; None where it cannot be known yet."""
        now = self._clock()
        if status.directory != self._of:  # a run that a run makes first has a pace of its own
            self._of, self._mark = status.directory, None
        if self._mark is None and status.step >= self._warmup and status.phase == "training":
            self._mark = status.step, now
        if self._mark is not None and status.step > self._mark[0] and now - self._mark[1] >= SEEN:
            return (now - self._mark[1]) / (status.step - self._mark[0]) * (status.steps - status.step)
        left = None if self._whole is None else self._whole - (now - self._began)
        return left if left is not None and left > 0.0 else None  # arithmetic that was wrong says no more


def said(seconds: float | None) -> str:
    """In words, such as ``19 min left``; empty where it is not known."""
    if seconds is None:
        return ""
    if seconds < 90:
        return f"{seconds:.0f} s left"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min left"
    return f"{seconds / 3600:.1f} h left"
