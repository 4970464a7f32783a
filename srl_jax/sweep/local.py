"""The engine of one machine: packs one after another or side by side, each a process that keeps to its own cores."""

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

from srl_jax import machine
from srl_jax.sweep import attempts
from srl_jax.sweep.manifest import Sweep

IN_USE = 75  # EX_TEMPFAIL: another process works on the pack
USAGE = 2  # bad input: it would fail again
POLL = 0.2


def command(directory: Path, number: int) -> list[str]:
    """What a task runs, by whichever engine."""
    return [sys.executable, "-m", "srl_jax.sweep", "--out", str(directory), "--run-pack", str(number)]


def unfinished(sweep: Sweep) -> list[int]:
    """The packs without a summary."""
    return [pack.number for pack in sweep.packs() if not (pack.directory / "summary.json").exists()]


def run(
    sweep: Sweep,
    *,
    cpus: int,
    jobs: int,
    retries: int,
    stopped: Callable[[], bool] = lambda: False,
    told: Callable[[int, int], None] = lambda number, code: None,
) -> list[int]:
    """Works on every unfinished pack until it is done or has failed for good; returns those that are not done.

    Args:
        sweep: whose manifest is written.
        cpus: cores of a task.
        jobs: tasks at once.
        retries: further attempts at a pack that failed, none where its input is bad.
        stopped: asked now and then; once True, running tasks are asked to save and no other is begun.
        told: called with the number of each pack that ends and its exit code.
    """
    slots, cores = deque(range(jobs)), core_sets(cpus, jobs)
    waiting = deque((number, retries) for number in unfinished(sweep))
    running: dict[int, tuple[subprocess.Popen, int, int]] = {}
    asked = False
    while running or (waiting and not asked):
        while waiting and slots and not stopped():
            number, left = waiting.popleft()
            slot = slots.popleft()
            running[number] = _start(sweep, number, cores[slot]), slot, left
        if stopped() and not asked:
            asked = True
            for process, _, _ in running.values():
                process.terminate()
        for number, (process, slot, left) in list(running.items()):
            code = process.poll()
            if code is None:
                continue
            del running[number]
            slots.append(slot)
            told(number, code)
            if code not in (0, USAGE, IN_USE) and left and not asked:
                waiting.append((number, left - 1))
        time.sleep(POLL)
    return unfinished(sweep)


def core_sets(cpus: int, jobs: int) -> Sequence[set[int] | None]:
    """The cores of each of the tasks that run at once; None where a system does not bind processes to cores.

    Raises:
        ValueError: there are not so many.
    """
    if cpus * jobs > machine.cores():
        raise ValueError(
            f"cpus is {cpus} and jobs {jobs}: together they want {cpus * jobs} cores, this machine has "
            f"{machine.cores()}."
        )
    if not hasattr(os, "sched_getaffinity"):
        return [None] * jobs
    own = sorted(os.sched_getaffinity(0))
    return [set(own[slot * cpus : (slot + 1) * cpus]) for slot in range(jobs)]


def _start(sweep: Sweep, number: int, cores: set[int] | None) -> subprocess.Popen:
    log = sweep.task_directory(number) / "log"
    log.parent.mkdir(parents=True, exist_ok=True)
    # A group of its own, so that Ctrl-C reaches it once: by this process.
    with log.open("ab") as file:
        process = subprocess.Popen(
            command(sweep.directory, number), stdout=file, stderr=subprocess.STDOUT, process_group=0
        )
    if cores is not None:
        os.sched_setaffinity(process.pid, cores)  # before it has any thread but its first
    return process


def state_of(sweep: Sweep, number: int) -> attempts.Fate:
    """How a pack stands."""
    return attempts.fate(sweep.task_directory(number), sweep.pack(number).directory)
