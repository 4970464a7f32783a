"""The machine that a job runs on: its cores, the memory it has used, and the versions of what is installed."""

import contextlib
import math
import os
import sys
from importlib import metadata
from pathlib import Path

SLURM = "SLURM_CPUS_PER_TASK"
CGROUPS, OWN_CGROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
PACKAGES = (
    "srl-jax",
    "jax",
    "jaxlib",
    "mujoco",
    "mujoco-mjx",
    "numpy",
    "flax",
    "optax",
    "distrax",
    "orbax-checkpoint",
)


def cores() -> int:
    """Cores that this process may keep busy: those it is allowed, or fewer where a container or Slurm says so."""
    # macOS and Windows do not tell a process which cores are its own.
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    given = os.environ.get(SLURM, "")  # which does not bind tasks to cores on every cluster
    granted = int(given) if given.isdecimal() and int(given) > 0 else math.inf
    return max(1, math.ceil(min(allowed, granted, cpu_quota(CGROUPS, OWN_CGROUPS))))


def xla_threads(devices: int) -> int:
    """Threads of the pool on which XLA runs so many devices of a CPU."""
    wanted = os.environ.get("NPROC", "")
    return max(devices, int(wanted) if wanted.isdecimal() and int(wanted) > 0 else cores())


def cpu_quota(root: Path, own: Path) -> float:
    """Cores' worth of time that the cgroups of Linux grant, infinite where they set no limit.

    Args:
        root: where cgroups are mounted; version 2 there or under ``unified``, version 1 a folder per controller.
        own: the file that names the process's groups, as ``number:controllers:path``.

    Limits nest, so the tightest of a group and those above it counts. Inside a container the named path is often that
    of the machine outside, which is not mounted; its own limit then lies at the root.
    """
    limits = [math.inf]
    for line in _read(own).splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers:
            tops = [root, root / "unified"]
        elif "cpu" in controllers.split(","):
            tops = [root / "cpu", root / controllers]
        else:
            continue
        group = Path(path.lstrip("/"))
        limits += [_limit(top / above) for top in tops for above in (group, *group.parents)]
    return min(limits)


def _limit(group: Path) -> float:
    """The quota of one group in cores; infinite where it has none."""
    quota, _, period = _read(group / "cpu.max").strip().partition(" ")  # version 2: "150000 100000" or "max 100000"
    if not quota:
        quota, period = (_read(group / f"cpu.cfs_{name}_us").strip() for name in ("quota", "period"))
    if not (quota.isdigit() and period.isdigit() and int(period)):  # "max", version 1's -1, or no such file
        return math.inf
    return int(quota) / int(period)


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""


def peak_memory_gib() -> float | None:
    """The most memory that this process has held, GiB; None where the system does not say."""
    try:
        import resource  # not on Windows
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, kB elsewhere
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30, 2)


def versions() -> dict[str, str]:
    """The installed versions of the packages that decide a result."""
    found = {}
    for name in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found
