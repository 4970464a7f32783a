"""The devices of a job: how many, and jax set up for them before it starts."""

import os
from pathlib import Path

from srl_jax import machine


def use_devices(wanted: str, lanes: int | None = None, *, solves: bool = True) -> int:
    """Sets jax up for the devices, before it starts; returns how many there are.

    On a CPU: one XLA device per core, and as many threads in XLA's pool, so that every device keeps its core to itself.
    With more threads it goes from one to another with each independent operation, a third slower. But LAPACK waits for
    another thread to help it, for ever where each is a device that waits: programs that call it need threads to spare.

    Args:
        wanted: ``auto`` or a number.
        lanes: there are never more devices than these, whatever is wanted: the others would have nothing to do, and
            no lane's numbers depend on them.
        solves: whether the program may solve linear systems, which XLA leaves to LAPACK.

    Raises:
        ValueError: `wanted` is neither auto nor a positive number, or more than there are.
    """
    if wanted != "auto" and not (wanted.isdecimal() and int(wanted) > 0):
        raise ValueError(f"devices is {wanted!r}: give auto or a positive number.")
    cores = machine.cores()
    most = 4 * cores
    count = cores if wanted == "auto" else int(wanted)
    on_cpu = min(count, lanes or count, most)
    threads = 2 * max(on_cpu, cores) if solves else on_cpu if on_cpu > 1 else cores
    os.environ.setdefault("NPROC", str(threads))
    import jax

    if jax.config.jax_compilation_cache_dir is None:  # not the variable: jax reads it once, and may be imported already
        cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "srl_jax"
        jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_num_cpu_devices", on_cpu)
    if (backend := jax.default_backend()) == "cpu":
        if count > most:
            raise ValueError(f"devices is {wanted}: this machine has {cores} cores.")
        return on_cpu
    found = len(jax.devices())
    if wanted != "auto" and count > found:
        raise ValueError(f"devices is {wanted}: this machine has {found} {backend} devices.")
    count = found if wanted == "auto" else count
    return min(count, lanes or count)
