"""The devices of a job: how many, and jax set up for them before it starts."""

import os
from pathlib import Path

from srl_jax import machine


def use_devices(wanted: str, lanes: int | None = None) -> int:
    """Sets jax up for the devices, before it starts; returns how many there are.

    On a CPU: one XLA device per core. Its thread pool must be larger than the number of devices, or they deadlock.

    Args:
        wanted: ``auto`` or a number.
        lanes: there are never more devices than these, whatever is wanted: the others would have nothing to do, and
            no lane's numbers depend on them.

    Raises:
        ValueError: `wanted` is neither auto nor a positive number, or more than there are.
    """
    if wanted != "auto" and not (wanted.isdecimal() and int(wanted) > 0):
        raise ValueError(f"devices is {wanted!r}: give auto or a positive number.")
    cores = machine.cores()
    most = 4 * cores
    count = cores if wanted == "auto" else int(wanted)
    on_cpu = min(count, lanes or count, most)
    os.environ.setdefault("NPROC", str(2 * max(on_cpu, cores)))
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
