"""The whole job side by side: ten seeds of DDPG under each of six damages, every run as long as this package's are.

Equal in environment steps, updates, mini-batches and widths (`baselines` says where libraries cannot be made equal);
nobody evaluates, draws or saves anything. Whole runs take hours, so that mostly a part of one is timed in the midst of
learning, and the rest is reckoned: the seconds to begin, those to begin anew, and the steps at the measured rate.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from importlib import util
from typing import NamedTuple

from experiments.contenders import ours
from experiments.contenders.measuring import Contender, Result, Runner, cores, interleave
from experiments.contenders.physics import COLD, ON_CPU
from srl_jax.config import Config

TITLES = {
    "ours": "ours",
    "ours_mjx": "ours, but MJX",
    "vmap": "vmap over seeds, MJX",
    "sbx": "SBX",
    "sb3": "Stable-Baselines3",
}
NEEDS = {"sbx": "sbx", "sb3": "stable_baselines3"}  # modules of the extra


class Entry(NamedTuple):
    """One contender of the job and what its runs are."""

    contender: Contender
    turns: int  # which a process takes one after the other: of a run, or of all seeds at once
    width: int  # runs in a turn


class Total(NamedTuple):
    """What the whole job takes."""

    result: Result
    seconds: float | None
    reckoned: bool  # and not measured from begin to end


def missing(wanted: Sequence[str]) -> list[str]:
    """Those of the wanted contenders whose libraries are not installed."""
    return [name for name in wanted if name in NEEDS and util.find_spec(NEEDS[name]) is None]


def in_library(library: str, config: Config, runs: Sequence[tuple[int, str]], steps: int) -> Runner:
    """DDPG of ``sbx`` or ``sb3``; see `baselines.runner`."""
    from experiments.contenders import baselines  # which brings torch

    return baselines.runner(library, config, runs, steps)


def under_vmap(config: Config, seeds: Sequence[int], names: Sequence[str], steps: int) -> Runner:
    """All seeds in one `vmap`; see `vmapped.runner`."""
    from experiments.contenders import vmapped  # which brings jax

    return vmapped.runner(config, seeds, names, steps)


def entries(config: Config, steps: int, wanted: Sequence[str], cold: bool) -> list[Entry]:
    """Everyone who takes part: this package in one process, the others in one and in a process a core."""
    from srl_jax.job import plan

    lanes, own = plan.make(config).lanes, cores()
    seeds, names = (list(dict.fromkeys(getattr(lane, field) for lane in lanes)) for field in ("seed", "damage"))
    everywhere, apart = (tuple(own),), tuple((core,) for core in own)
    environment = ON_CPU | (COLD if cold else {})
    found = []
    for name in wanted:
        if name in ("ours", "ours_mjx"):
            physics = "mjx" if name == "ours_mjx" else config.env.physics
            own_config = dataclasses.replace(config, env=dataclasses.replace(config.env, physics=physics))
            make = partial(ours.of_steps, own_config, min(len(own), len(lanes)), steps)
            found.append(Entry(Contender(TITLES[name], make, everywhere, environment), 1, len(lanes)))
            continue
        for where, on in (("one process", everywhere), ("a process a core", apart)):
            if len(on) > 1 or where == "one process":
                share = -(-len(lanes) // len(on)), -(-len(names) // len(on))
                runs = [(lane.seed, lane.damage) for lane in lanes][: share[0]]
                if name == "vmap":
                    make, turns, width = (
                        partial(under_vmap, config, seeds, names[: share[1]], steps),
                        share[1],
                        len(seeds),
                    )
                else:
                    make, turns, width = partial(in_library, name, config, runs, steps), share[0], 1
                found.append(Entry(Contender(f"{TITLES[name]}, {where}", make, on, environment), turns, width))
    return found


def total(entry: Entry, result: Result, steps: int) -> Total:
    """The seconds of the whole job: of a process that has as many turns as any.

    Args:
        entry: who.
        result: what was measured.
        steps: of each run.
    """
    if result.failed:
        return Total(result, None, True)
    facts, median = result.facts, result.units / result.rate
    if facts.get("whole"):
        return Total(result, result.start + median, False)
    again = facts["again_seconds"]
    begin = result.start - (again if facts["again_in_start"] else 0.0)
    rate = result.rate / len(entry.contender.cores) / entry.width  # steps per second of a run in its process
    return Total(result, begin + (entry.turns - 1) * again + entry.turns * (steps - facts["done"]) / rate, True)


def side_by_side(
    config: Config, steps: int, rounds: int, wanted: Sequence[str], cold: bool, note: Callable[[str], None]
) -> list[Total]:
    """Everyone's total, in the order of `entries`."""
    whole = steps >= config.steps
    found = entries(config, steps, wanted, cold)
    if whole:  # each by itself: whoever has finished must not hold its memory on
        results = [interleave([entry.contender], 1, note)[0] for entry in found]
    else:
        results = interleave([entry.contender for entry in found], rounds, note)
    return [total(entry, result, config.steps) for entry, result in zip(found, results, strict=True)]


def rows(found: Sequence[Total]) -> tuple[list[str], list[list[str]]]:
    """The table's titles and rows; how many times as long as the first contender the others take."""
    body, first = [], found[0].seconds
    for result, seconds, reckoned in found:
        if seconds is None:
            body.append([result.name, "failed", *["-"] * 5])
            continue
        again = result.facts.get("again_seconds", 0.0)
        body.append(
            [
                result.name,
                f"{result.rate:,.0f} ± {result.spread:.0%}",
                f"{result.start - (again if result.facts.get('again_in_start') else 0.0):.0f}",
                f"{again:.1f}" if again else "-",
                f"{seconds / 60:,.1f}" + (" (reckoned)" if reckoned else ""),
                f"{seconds / first:.1f}" if first else "-",
                "-" if result.peak is None else f"{result.peak:.2f}",
            ]
        )
    titles = ["contender", "environment steps/s, all runs", "s to begin", "s to begin anew", "minutes for the job"]
    return [*titles, f"times {found[0].result.name}", "GiB at most, all processes"], body
