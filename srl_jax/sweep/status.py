"""How a sweep stands: how many packs are done, running, waiting or failed, how fast it goes, when it will be over."""

from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime

from srl_jax.sweep import attempts
from srl_jax.sweep.manifest import Sweep

SHOWN = 10  # failed packs that are named


@dataclass
class Status:
    """Of all packs."""

    counts: Counter[str] = field(default_factory=Counter)
    troubled: list[tuple[int, attempts.Fate]] = field(default_factory=list)  # packs that failed, or lanes of theirs
    lanes_per_hour: float = 0.0
    hours_left: float | None = None


def status(sweep: Sweep, now: datetime | None = None) -> Status:
    """Reads how every pack stands; what is left is reckoned from the packs that were done since the first began."""
    found, began, ended = Status(), [], []
    for pack in sweep.packs():
        fate = attempts.fate(pack)
        found.counts[fate.state] += 1
        if fate.state in ("failed", "cut off") or (fate.state == "done" and fate.error):
            found.troubled.append((pack.number, fate))
        if fate.began:
            began.append(datetime.fromisoformat(fate.began))
        if fate.state == "done":
            ended.append(pack.number)
    if ended and began:
        hours = max(((now or datetime.now(UTC)) - min(began)).total_seconds() / 3600, 1e-6)
        each = sum(sum(point.lanes.values()) for point in sweep.points) / len(sweep)
        found.lanes_per_hour = len(ended) * each / hours
        found.hours_left = (len(sweep) - len(ended)) * hours / len(ended)
    return found


def lines(sweep: Sweep, found: Status) -> list[str]:
    """The status in words."""
    total = len(sweep)
    order = ("done", "running", "waiting", "cut off", "failed")
    text = [f"{total} packs: " + ", ".join(f"{found.counts[state]} {state}" for state in order if found.counts[state])]
    if found.hours_left:
        text[0] += f"; {found.lanes_per_hour:,.0f} lanes an hour, {_duration(found.hours_left)} left at this rate"
    for number, fate in found.troubled[:SHOWN]:
        times = f"{fate.attempts} attempt{'s' if fate.attempts != 1 else ''}"
        text.append(f"pack {number:05d} {fate.state} on {fate.host} ({times}): {fate.error}")
    if len(found.troubled) > SHOWN:
        text.append(f"and {len(found.troubled) - SHOWN} more.")
    return text


def _duration(hours: float) -> str:
    if hours >= 48:
        return f"{hours / 24:.0f} days"
    return f"{hours:.1f} hours" if hours >= 1 else f"{max(1, round(hours * 60))} min"
