"""The engine of a Ray cluster: packs as tasks that Ray starts again, elsewhere, when a node or a process is lost.

A task is the same process as under every other engine, beside Ray's own worker, so that jax starts on its own cores.
"""

import contextlib
import os
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from srl_jax import machine
from srl_jax.sweep import task
from srl_jax.sweep.task import Order

POLL, PAUSE = 1.0, 10.0  # s between looks at what has ended, and at a pack in use
NAME = "srl_jax-cores"  # of the files that say which cores of a node are taken


def run(order: Order, address: str = "") -> None:
    """Works through the order on the cluster of an address, or on one started here; Ray decides how many run at once.

    Raises:
        ValueError: Ray is not installed, or there is no such cluster.
    """
    ray = _started(address)
    remote = ray.remote(num_cpus=order.cpus, max_retries=order.retries, retry_exceptions=True)(work)
    directory = str(order.sweep.directory)
    waiting = {remote.remote(directory, number, order.cpus): number for number in order.sweep.unfinished()}
    asked = False
    try:
        while waiting:
            done, _ = ray.wait(list(waiting), timeout=POLL)
            for reference in done:
                order.told(waiting.pop(reference), _code(ray, reference))
            if order.stopped() and not asked:
                asked = True
                for reference in waiting:
                    ray.cancel(reference, force=False)
    finally:
        ray.shutdown()


def work(directory: str, number: int, cpus: int) -> int:
    """One task on a node: the pack's process on cores of its own. An error makes Ray try again.

    Where Ray has lost a node that still lives, its task goes on there; then this one waits for what becomes of it.
    """
    with own_cores(cpus) as cores:
        while (code := _once(directory, number, cores)) == task.IN_USE:
            time.sleep(PAUSE)
    if task.may_succeed(code):
        raise RuntimeError(f"pack {number} ended with code {code}")
    return code


def _once(directory: str, number: int, cores: set[int]) -> int:
    # Without a leader a task would go on when its worker is lost, and hold the pack.
    own = os.environ | {task.LEADER: str(os.getpid())}
    process = task.begin(Path(directory), number, cores, env=own)
    try:
        return process.wait()
    except BaseException:  # cancelled: it saves before it ends
        process.terminate()
        process.wait()
        raise


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
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "os.fork", RuntimeWarning)  # Ray's children run no jax
            ray.init(**options, log_to_driver=False, logging_level="error")
    except ConnectionError as error:
        raise ValueError(f"ray_address is {address!r}: no cluster answers there ({error}).") from None
    return ray


def _code(ray: Any, reference: Any) -> int:
    try:
        return ray.get(reference)
    except Exception:
        return 1
