"""Signals that ask a job to stop."""

import signal
from typing import Any


class StopSignals:
    """Remembers the first SIGINT or SIGTERM, so that the job can save before it ends; a second one ends it at once."""

    def __init__(self) -> None:
        self.number = 0
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._remember)

    def _remember(self, number: int, frame: Any) -> None:
        self.number = number
        signal.signal(number, signal.SIG_DFL)

    def requested(self) -> bool:
        """Whether a signal has come."""
        return self.number != 0
