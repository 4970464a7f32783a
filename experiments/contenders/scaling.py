"""What a lane of DDPG costs in this package's program, in time and memory, as lanes grow more; on one or two cores."""

import dataclasses
import statistics
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from experiments.contenders import ours
from experiments.contenders.measuring import Contender, Result, Team, cores, interleave
from experiments.contenders.physics import COLD, ON_CPU
from srl_jax.config import Config

FLAT = 16  # lanes from which on a lane should cost the same
SLACK = 0.1  # share by which the cost may differ


def config(lanes: int, capacity: int, base: Config) -> Config:
    """So many seeds of DDPG, one lost leg, replays of so many transitions; all else is that of the base."""
    few = {name: min(getattr(base.train, name), capacity) for name in ("warmup", "prior_steps")}
    train = dataclasses.replace(base.train, capacity=capacity, **few)
    return dataclasses.replace(base, algos="ddpg", seeds=str(lanes), damage="leg_rm", train=train, memory_gb=1e6)


class Row(NamedTuple):
    """One number of lanes on one number of devices."""

    result: Result
    relative: float | None  # what a lane costs, in units of a lane of `FLAT` in the same rounds


def side_by_side(
    counts: Sequence[int],
    capacity: int,
    base: Config,
    rounds: int,
    least: float,
    cold: bool,
    note: Callable[[str], None],
) -> dict[int, list[Row]]:
    """Numbers of lanes one after the other, on one device and then on two where there are two cores.

    `FLAT` lanes are timed beside each of them, in every round: what is compared with them is so in the same minutes,
    and no more than two programs share the memory.

    Returns:
        Rows, in the order of those `counts` that fill the devices, by number of devices.
    """
    own, found = cores(), {}
    for devices in (1, 2)[: len(own)]:
        on = (tuple(own[:devices]),)

        def contender(lanes: int, devices=devices, on=on) -> Contender:
            make = partial(ours.of_time, config(lanes, capacity, base), devices, least)
            return Contender(f"{lanes} lanes", make, on, ON_CPU | (COLD if cold else {}))

        said = lambda said, devices=devices: note(f"{devices} devices, {said}")  # noqa: E731
        reference = Team(contender(FLAT)) if max(counts) >= FLAT else None
        found[devices] = []
        for lanes in counts:
            if lanes >= devices:
                (result,) = interleave([contender(lanes)], rounds, said, reference)
                found[devices].append(Row(result, _relative(result, reference, rounds)))
        if reference:
            reference.result()
    return found


def _relative(result: Result, reference: Team | None, rounds: int) -> float | None:
    if reference is None or reference.failed or result.failed:
        return None
    return cost(result) * reference.units / statistics.median(reference.seconds[-rounds:])


def cost(result: Result) -> float:
    """Seconds of an environment step of one lane, updates included, on all devices together."""
    return 1.0 / result.rate


def rows(found: dict[int, list[Row]]) -> tuple[list[str], list[list[str]]]:
    """The table's titles and rows."""
    body = []
    for devices, several in found.items():
        for one, relative in several:
            if one.failed:
                body.append([str(devices), one.name.split()[0], "failed", *["-"] * 5])
                continue
            body.append(
                [
                    str(devices),
                    f"{one.facts['lanes']:,}",
                    f"{one.rate:,.0f} ± {one.spread:.0%}",
                    f"{1e6 * cost(one):,.0f}",
                    "-" if relative is None else f"{relative:.2f}",
                    f"{one.facts['compile_seconds']:.0f}",
                    f"{one.facts['arithmetic_bytes'] / 2**30:.2f}",
                    "-" if one.peak is None else f"{one.peak:.2f}",
                ]
            )
    titles = ["devices", "lanes", "environment steps/s", "us a step", f"in steps of {FLAT} lanes", "compile s"]
    return [*titles, "GiB by arithmetic", "GiB at most"], body


def verdict(found: dict[int, list[Row]]) -> str:
    """Whether a lane costs the same, within `SLACK`, from `FLAT` lanes on; empty where that was not measured."""
    said = []
    for devices, several in found.items():
        costs = {one.facts["lanes"]: relative for one, relative in several if relative is not None}
        costs = {lanes: relative for lanes, relative in costs.items() if lanes >= FLAT}
        if not costs:
            continue
        worst = max(costs, key=lambda lanes: abs(costs[lanes] - 1.0))
        flat = "flat" if abs(costs[worst] - 1.0) <= SLACK else "not flat"
        said.append(
            f"{devices} device{'s' * (devices > 1)}: {flat} within {SLACK:.0%} from {FLAT} lanes on; "
            f"farthest off are {worst:,} lanes, {costs[worst] - 1.0:+.0%}"
        )
    return "; ".join(said)
