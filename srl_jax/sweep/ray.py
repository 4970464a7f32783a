"""The engine of a Ray cluster: packs as tasks that Ray starts again, elsewhere, when a node or a process is lost.

A task is the same process as under every other engine, beside Ray's own worker, so that jax starts on its own cores.
"""

import contextlib
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from srl_jax import machine
from srl_jax.sweep.local import IN_USE, USAGE, command, unfinished
from srl_jax.sweep.manifest import Sweep

POLL = 1.0  # s
NAME = "srl_jax-cores"  # of the files that say which cores of a node are taken


def run(
    sweep: Sweep,
    *,
    cpus: int,
    jobs: int,
    retries: int,
    stopped: Callable[[], bool] = lambda: False,
    told: Callable[[int, int], None] = lambda number, code: None,
    address: str = "",
) -> list[int]:
    """As `local.run`, on an existing cluster (`address`) or, without one, on one that is started here.

    Args:
        sweep: whose manifest is written, in a directory that every node sees.
        cpus: cores of a task.
        jobs: ignored: as many tasks run at once as there are cores for.
        retries: further attempts at a pack whose node or process was lost, or that failed.
        stopped: asked now and then; once True, running tasks are asked to save.
        told: called with the number of each pack that ends and its exit code.
        address: of the cluster.

    Raises:
        ValueError: Ray is not installed, or there is no such cluster.
    """
    del jobs
    ray = _started(address)
    task = ray.remote(num_cpus=cpus, max_retries=retries, retry_exceptions=True)(work)
    waiting = {task.remote(str(sweep.directory), number, cpus): number for number in unfinished(sweep)}
    asked = False
    try:
        while waiting:
            done, _ = ray.wait(list(waiting), timeout=POLL)
            for reference in done:
                told(waiting.pop(reference), _code(ray, reference))
            if stopped() and not asked:
                asked = True
                for reference in waiting:
                    ray.cancel(reference, force=False)
    finally:
        ray.shutdown()
    return unfinished(sweep)


def work(directory: str, number: int, cpus: int) -> int:
    """One task on a node: the pack's process on cores of its own. An error makes Ray try again."""
    with own_cores(cpus) as cores:
        process = subprocess.Popen(command(Path(directory), number))
        try:
            if cores and hasattr(os, "sched_setaffinity"):
                os.sched_setaffinity(process.pid, cores)
            code = process.wait()
        except BaseException:  # cancelled: it saves before it ends
            process.terminate()
            process.wait()
            raise
    if code not in (0, USAGE, IN_USE):
        raise RuntimeError(f"pack {number} ended with code {code}")
    return code


@contextlib.contextmanager
def own_cores(cpus: int) -> Iterator[set[int]]:
    """Cores of this node that no other task has: Ray counts cores and gives out none. Empty where all are taken."""
    own = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(machine.cores()))
    for slot in range(len(own) // cpus):
        with (Path(tempfile.gettempdir()) / f"{NAME}-{cpus}-{slot}").open("w") as file:
            if _locked(file):
                yield set(own[slot * cpus : (slot + 1) * cpus])
                return
    yield set()


def _locked(file: Any) -> bool:
    try:
        import fcntl  # not on Windows

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):
        return False
    return True


def _started(address: str) -> Any:
    try:
        import ray
    except ImportError:
        raise ValueError("engine is ray: Ray is not installed; pip install 'srl-jax[ray]'.") from None
    options = {"address": address} if address else {"num_cpus": machine.cores(), "include_dashboard": False}
    try:
        ray.init(**options, log_to_driver=False, logging_level="error")
    except ConnectionError as error:
        raise ValueError(f"ray_address is {address!r}: no cluster answers there ({error}).") from None
    return ray


def _code(ray: Any, reference: Any) -> int:
    try:
        return ray.get(reference)
    except Exception:
        return 1
