"""What a run tells while it goes on, and how long its parts have taken, earlier processes included."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from srl_jax import machine
from srl_jax.config import Config
from srl_jax.env.hexapod import SUBSTEPS


@dataclass
class Progress:
    """What a display shows."""

    directory: Path  # where the results go
    phase: str
    step: int
    steps: int
    elapsed: float  # s of training
    environment_rate: float  # environment steps per second, all lanes
    update_rate: float  # gradient updates per second, all lanes
    latest: dict[str, dict[str, float]]  # per algorithm, means over its lanes at the last evaluation
    note: str = ""  # worth a line of its own, once


Listener = Callable[[Progress], None]


@dataclass
class Totals:
    """Of all processes that worked on a run."""

    training_seconds: float = 0.0
    trained: int = 0  # environment steps of a lane
    compile_seconds: float = 0.0
    peak_memory_gib: float | None = None

    @contextmanager
    def training(self) -> Iterator[None]:
        """Counts the time of a block."""
        begin = time.perf_counter()
        yield
        self.training_seconds += time.perf_counter() - begin

    def stored(self, compile_seconds: float) -> dict[str, Any]:
        """As JSON, with what this process spent on compiling."""
        return asdict(self.now(compile_seconds))

    def now(self, compile_seconds: float) -> "Totals":
        """The totals up to now."""
        peaks = [peak for peak in (self.peak_memory_gib, machine.peak_memory_gib()) if peak is not None]
        seconds = self.compile_seconds + compile_seconds
        return Totals(self.training_seconds, self.trained, seconds, max(peaks, default=None))

    def rates(self, config: Config, lanes: int, learners: int) -> tuple[float, float]:
        """Environment steps per second of all lanes together, and updates of those that learn from a replay."""
        each = self.trained / self.training_seconds if self.training_seconds else 0.0
        return lanes * each, learners * each / config.train.steps_an_update

    def summary(
        self, config: Config, lanes: int, learners: int, devices: int, compile_seconds: float
    ) -> dict[str, Any]:
        """The entry `machine` of summary.json."""
        total = self.now(compile_seconds)
        rate, updates = self.rates(config, lanes, learners)
        return {
            "devices": devices,
            "lanes": lanes,
            "training_seconds": round(total.training_seconds, 1),
            "compile_seconds": round(total.compile_seconds, 1),
            "environment_steps_per_second": round(rate),
            "physics_steps_per_second": round(rate * SUBSTEPS),
            "updates_per_second": round(updates),
            "peak_memory_gib": total.peak_memory_gib,
        }


def together(machines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What parts of a run took, by their entries `machine`: sums of seconds and lanes, means of rates, highest peak."""
    sums = {name: sum(part[name] for part in machines) for name in ("lanes", "training_seconds", "compile_seconds")}
    rates = [name for name in machines[0] if name.endswith("_per_second")]
    means = {name: round(sum(part[name] for part in machines) / len(machines)) for name in rates}
    peaks = [part["peak_memory_gib"] for part in machines if part["peak_memory_gib"] is not None]
    return machines[0] | sums | means | {"peak_memory_gib": max(peaks, default=None)}


@dataclass
class Pace:
    """How many vector steps fit between two looks at signals and at the display, by how long they have taken."""

    target: float = 2.0  # s
    seconds: float = field(default=2.0, init=False)  # of one vector step; the first slice is a single one

    @property
    def steps(self) -> int:
        return max(1, int(self.target / self.seconds))

    @contextmanager
    def timing(self, steps: int) -> Iterator[None]:
        """Learns from how long a block takes that makes so many vector steps."""
        begin = time.perf_counter()
        yield
        self.seconds = max((time.perf_counter() - begin) / steps, 1e-6)
