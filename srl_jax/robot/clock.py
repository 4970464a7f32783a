"""Time, as the loop is given it: that of the machine, or of a simulation that need not wait for it."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds that only grow."""

    def now(self) -> float:
        """Seconds since some moment."""
        ...

    def sleep_until(self, moment: float) -> None:
        """Returns at a moment, or at once where it has passed."""
        ...


class RealClock:
    """The machine's monotonic clock, which nobody sets."""

    def now(self) -> float:
        """Seconds since some moment."""
        return time.monotonic()

    def sleep_until(self, moment: float) -> None:
        """Returns at a moment, or at once where it has passed."""
        left = moment - time.monotonic()
        if left > 0.0:
            time.sleep(left)
