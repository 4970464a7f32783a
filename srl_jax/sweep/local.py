"""The engine of one machine: packs one after another or side by side, each a process that keeps to its own cores."""

import os
import subprocess
import time
from collections import deque
from collections.abc import Sequence

from srl_jax import machine
from srl_jax.sweep import task
from srl_jax.sweep.manifest import Sweep
from srl_jax.sweep.task import Order

POLL = 0.2


def run(order: Order) -> None:
    """Works through the order.

    Raises:
        ValueError: it wants more cores than there are.
    """
    slots, cores = deque(range(order.jobs)), core_sets(order.cpus, order.jobs)
    waiting = deque((number, order.retries) for number in order.sweep.unfinished())
    running: dict[int, tuple[subprocess.Popen, int, int]] = {}
    asked = False
    while running or (waiting and not asked):
        while waiting and slots and not order.stopped():
            number, left = waiting.popleft()
            try:
                process = _start(order.sweep, number, cores[slots[0]])
            except OSError:  # a full disk has no room for its log; the others go on
                order.told(number, task.FAILED)
                waiting.extend([(number, left - 1)] if left else [])
                time.sleep(POLL)
                continue
            running[number] = process, slots.popleft(), left
        if order.stopped() and not asked:
            asked = True
            for process, _, _ in running.values():
                process.terminate()
        for number, (process, slot, left) in list(running.items()):
            code = process.poll()
            if code is None:
                continue
            del running[number]
            slots.append(slot)
            order.told(number, code)
            if task.may_succeed(code) and left and not asked:
                waiting.append((number, left - 1))
        time.sleep(POLL)


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
    log = sweep.pack(number).task / "log"
    log.parent.mkdir(parents=True, exist_ok=True)
    # A group of its own, so that Ctrl-C reaches it once: by this process.
    with log.open("ab") as file:
        return task.begin(sweep.directory, number, cores, stdout=file, stderr=subprocess.STDOUT, process_group=0)
