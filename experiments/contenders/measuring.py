"""Contenders in processes of their own, each on its own cores, measured in turn, round by round.

A machine that others slow down for a minute then slows every contender down alike. Imports no jax: the process that
asks must be small, since what it starts counts its memory as a part of its own peak.
"""

import multiprocessing
import os
import statistics
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from srl_jax import machine

POWERCAP = Path("/sys/class/powercap")


@dataclass(frozen=True)
class Runner:
    """What is timed, made and compiled in the process that runs it."""

    run: Callable[[], Any]
    units: float  # steps that a run takes
    facts: dict[str, Any] = field(default_factory=dict)  # what else it has to say


@dataclass(frozen=True)
class Contender:
    """One of those that are compared."""

    name: str
    make: Callable[[], Runner]  # a function of a module, or a `partial` of one, so that another process finds it
    cores: tuple[tuple[int, ...], ...]  # those of each of its processes
    environment: dict[str, str] = field(default_factory=dict)  # variables of its processes, before jax starts


@dataclass(frozen=True)
class Result:
    """What a contender did. Times in seconds, memory in GiB, over all of its processes together."""

    name: str
    cores: int
    units: float = 0.0  # steps in a round
    seconds: tuple[float, ...] = ()  # of each round
    start: float = 0.0  # from nothing to ready, with importing and compiling
    peak: float | None = None
    joules: float | None = None  # in a round, of the whole machine; None where it cannot be read
    facts: dict[str, Any] = field(default_factory=dict)
    failed: str = ""

    @property
    def rate(self) -> float:
        """Steps per second, of the median round."""
        return self.units / statistics.median(self.seconds)

    @property
    def spread(self) -> float:
        """Half the distance of the fastest from the slowest round, as a share of the median."""
        return (max(self.seconds) - min(self.seconds)) / 2 / statistics.median(self.seconds)

    def record(self) -> dict[str, Any]:
        """As it is written to a file."""
        return {**vars(self), "rate": self.rate if self.seconds else None}


def cores() -> list[int]:
    """The cores that this process may use; numbered, where the system does not say which."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(machine.cores()))


@contextmanager
def pinned(wanted: Sequence[int]) -> Iterator[None]:
    """What is started inside runs on these cores only, all of its threads; without effect where there is no pinning."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, wanted)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def joules() -> float | None:
    """The machine's energy counters, all processor packages together, J; None where none can be read."""
    try:
        return sum(int(path.read_text()) for path in POWERCAP.glob("*:[0-9]/energy_uj")) / 1e6 or None
    except OSError:  # mostly root's alone
        return None


def calibrated(run: Callable[[int], Any], least: float) -> int:
    """How often to do something so that it takes at least so many seconds; it is done once before, to warm up."""
    run(1)
    count = 1
    while True:
        begin = time.perf_counter()
        run(count)
        taken = time.perf_counter() - begin
        if taken >= 0.8 * least:
            return count
        count = max(count + 1, int(count * min(least / max(taken, 1e-9), 10.0)))


def _serve(pipe: Any, make: Callable[[], Runner], environment: dict[str, str]) -> None:
    """The life of a contender's process: made, ready, then a timed run whenever it is asked for one."""
    os.environ.update(environment)
    try:
        runner = make()
        pipe.send((runner.units, runner.facts))
        while pipe.recv():
            begin = time.perf_counter()
            runner.run()
            pipe.send(time.perf_counter() - begin)
        pipe.send(machine.peak_memory_gib())
    except Exception:
        pipe.send(RuntimeError(traceback.format_exc(limit=-3)))


class Team:
    """A contender's processes, which run at the same time."""

    def __init__(self, contender: Contender):
        self.contender, self.pipes, self.processes = contender, [], []
        self.seconds: list[float] = []
        self.joules: list[float] = []
        self.peak, self.failed = None, ""
        context, begin = multiprocessing.get_context("spawn"), time.perf_counter()
        for own in contender.cores:
            pipe, other = context.Pipe()
            serve = partial(_serve, other, contender.make, contender.environment)
            process = context.Process(target=serve, daemon=True)
            with pinned(own):
                process.start()
            other.close()  # here, so that a process that is killed ends the pipe
            self.pipes.append(pipe)
            self.processes.append(process)
        said = self._hear()
        self.start = time.perf_counter() - begin
        self.units = sum(units for units, _ in said)
        self.facts = said[0][1] if said else {}

    def _hear(self) -> list[Any]:
        """What each process says; nothing once one has failed."""
        try:
            said = [pipe.recv() for pipe in self.pipes]
        except EOFError:
            said = [RuntimeError("its process was killed, probably for its memory")]
        self.failed = next((str(one) for one in said if isinstance(one, RuntimeError)), self.failed)
        return [] if self.failed else said

    def _ask(self, more: bool) -> list[Any]:
        if self.failed:
            return []
        for pipe in self.pipes:
            pipe.send(more)
        return self._hear()

    def round(self) -> None:
        """One run of every process at the same time."""
        before = joules()
        said = self._ask(True)
        after = joules()
        if said:
            self.seconds.append(max(said))
            if before and after and after > before:  # counters start anew now and then
                self.joules.append(after - before)

    def result(self) -> Result:
        """Ends the processes and says what they did."""
        peaks = self._ask(False)
        self.end()
        return Result(
            name=self.contender.name,
            cores=len({core for own in self.contender.cores for core in own}),
            units=self.units,
            seconds=() if self.failed else tuple(self.seconds),
            start=self.start,
            peak=sum(peaks) if peaks and None not in peaks else None,
            joules=statistics.median(self.joules) if self.joules else None,
            facts=self.facts,
            failed=self.failed,
        )

    def end(self) -> None:
        """Ends the processes, whatever they do."""
        for process in self.processes:
            process.join(5.0 if process.exitcode is None and not self.failed else 0.0)
            process.kill()


def interleave(
    contenders: Sequence[Contender], rounds: int, note: Callable[[str], None], beside: Team | None = None
) -> list[Result]:
    """Starts the contenders one after the other, then times them in turn, round by round.

    Args:
        contenders: those that are compared.
        rounds: how often each is timed.
        note: told what is under way.
        beside: one that runs already and takes part in every round; it goes on running.
    """
    teams = []
    try:
        for contender in contenders:
            note(f"starting {contender.name}")
            teams.append(Team(contender))
        for number in range(rounds):
            note(f"round {number + 1} of {rounds}")
            for team in [*teams, beside] if beside else teams:
                team.round()
        for team in teams:
            if team.failed:
                note(f"{team.contender.name} failed: {team.failed}")
        return [team.result() for team in teams]
    finally:
        for team in teams:
            team.failed = team.failed or "interrupted"
            team.end()
