"""What all engines share: the process that works on a pack, its exit codes, and what an engine is asked to do."""

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srl_jax.sweep.manifest import Sweep

PROGRAM = (sys.executable, "-m", "srl_jax.sweep")
DONE, FAILED, USAGE, IN_USE = 0, 1, 2, 75  # trained; the machine's fault; bad input; in use elsewhere (EX_TEMPFAIL)

LEADER = "SRL_JAX_LEADER"  # in a task's environment: the process that started it, if it is to be killed with that
PR_SET_PDEATHSIG = 1  # of Linux


@dataclass(frozen=True)
class Order:
    """What an engine is asked to do: work on every pack that is not done until it is, or has failed for good."""

    sweep: Sweep
    cpus: int  # cores of a task
    jobs: int  # tasks at once, where the engine does not decide that itself
    retries: int  # further attempts at a pack that failed or was lost, none where its input is bad
    stopped: Callable[[], bool] = lambda: False  # once True, running tasks are asked to save and no other is begun
    told: Callable[[int, int], None] = lambda number, code: None  # the number of each pack that ends, and its exit code


def command(directory: Path, number: int) -> list[str]:
    """The task of a pack."""
    return [*PROGRAM, "--out", str(directory), "--run-pack", str(number)]


def begin(directory: Path, number: int, cores: set[int] | None, **options: Any) -> subprocess.Popen:
    """The task as a process that keeps to some cores, where there are any given and the system binds processes."""
    process = subprocess.Popen(command(directory, number), **options)
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(process.pid, cores)  # before it has any thread but its first
    return process


def follow() -> None:
    """Has this process killed together with its leader, where it was given one and the system, Linux, does that."""
    leader = os.environ.pop(LEADER, "")
    if not leader or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(leader):  # it had died before
        os.kill(os.getpid(), signal.SIGKILL)


def may_succeed(code: int) -> bool:
    """Whether another attempt may do better than one that ended with this code."""
    return code not in (DONE, USAGE, IN_USE)
