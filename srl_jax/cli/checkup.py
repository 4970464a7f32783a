"""What a machine is to this package: what is installed, what it has, how fast it is, and what to change."""

import os
import platform
from collections.abc import Iterator, Mapping
from importlib import metadata, util
from pathlib import Path
from typing import Any, NamedTuple

import jax

from srl_jax import machine
from srl_jax.config import Config
from srl_jax.job import memory, plan, speed
from srl_jax.report.paint import backend
from srl_jax.sweep.cost import OF_RATES, Speed, run_seconds

GIB = 2**30
EXTRAS = {  # module: the extra that installs it
    "gymnasium": "gym",
    "onnx": "onnx",
    "ray": "ray",
    "tensorboardX": "tensorboard",
    "wandb": "wandb",
    "playwright": "web",
}
VARIABLES = (  # that decide how fast jax is
    *("NPROC", "XLA_FLAGS", "JAX_PLATFORMS", "JAX_ENABLE_COMPILATION_CACHE", "JAX_COMPILATION_CACHE_DIR"),
    *("JAX_ENABLE_X64", "JAX_DISABLE_JIT", "OMP_NUM_THREADS", "MUJOCO_GL", machine.SLURM),
)
SLOW = 0.5  # share of our core's speed, below which it is worth a word
BUSY = 0.25  # share of the cores that others may keep busy
GPU = Path("/dev/nvidia0")


class Host(NamedTuple):
    """What the machine has, without measuring."""

    python: str
    system: str
    cores: int  # that this process may keep busy
    machine_cores: int
    load: float  # mean number of running processes in the last minute
    memory_gib: float | None  # free now
    backend: str  # of jax
    devices: list[str]
    threads: int  # of XLA's pool
    cache: str  # where compiled programs are kept
    cache_writable: bool
    opengl: str | None  # egl or osmesa; None: pictures are cast by NumPy
    gpu: bool  # whether there is one, used or not
    variables: dict[str, str]


def host() -> Host:
    """This machine, jax having been set up by `use_devices`."""
    devices, cache = jax.devices(), Path(jax.config.jax_compilation_cache_dir or "")
    existing = next(path for path in (cache, *cache.parents) if path.exists())
    return Host(
        python=platform.python_version(),
        system=f"{platform.system()} {platform.machine()}",
        cores=machine.cores(),
        machine_cores=os.cpu_count() or 1,
        load=round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0,
        memory_gib=free_memory(),
        backend=jax.default_backend(),
        devices=[device.device_kind for device in devices],
        threads=machine.xla_threads(len(devices)),
        cache=str(cache),
        cache_writable=os.access(existing, os.W_OK),
        opengl=backend(),
        gpu=GPU.exists(),
        variables={name: os.environ[name] for name in VARIABLES if name in os.environ},
    )


def free_memory(info: Path = Path("/proc/meminfo")) -> float | None:
    """GiB that programs may still take; None where the system does not say."""
    lines = info.read_text().splitlines() if info.exists() else []
    found = dict(line.split(":", 1) for line in lines if ":" in line)
    return round(int(found["MemAvailable"].split()[0]) / 2**20, 1) if "MemAvailable" in found else None


def installed() -> dict[str, str | None]:
    """Versions of what decides a result, and of the extras; None: not installed."""
    extras: dict[str, str | None] = {name: None for name in EXTRAS}
    return machine.versions() | extras | {name: metadata.version(name) for name in EXTRAS if util.find_spec(name)}


def speeds(cores: int, repeats: int, size: int = speed.SIZE, robots: int = speed.ROBOTS) -> dict[str, float]:
    """Measured here: of all cores together in sgemm and C MuJoCo, of one device in the physics of a run."""
    return {
        "sgemm_gflops": round(speed.sgemm_rate(repeats, size) / 1e9, 1),
        "physics_steps_per_second_one_device": round(speed.physics_rate(repeats, robots)),
        "c_mujoco_steps_per_second": round(speed.c_mujoco_rate(cores, repeats)),
    }


def forecast(config: Config, cores: int, devices: int, measured: Mapping[str, float]) -> dict[str, Any]:
    """What ``make run`` will take; minutes are None on an accelerator."""
    lanes = plan.make(config).lanes
    each = Speed(measured["sgemm_gflops"] * 1e9 / cores, measured["physics_steps_per_second_one_device"])
    seconds = run_seconds(config, devices, each)
    return {
        "lanes": len(lanes),
        "steps": config.steps,
        "minutes": None if seconds is None else round(seconds / 60, 1),
        "memory_gib": round(sum(memory.needed(config, lanes, devices)) / GIB, 1),
    }


def advice(host: Host, found: Mapping[str, Any]) -> Iterator[str]:
    """What to change, a sentence each.

    Args:
        host: the machine.
        found: `speed` and `make_run`, as measured.
    """
    given = host.variables
    if host.gpu and host.backend == "cpu":
        yield "There is an NVIDIA GPU that jax does not use: pip install 'jax[cuda13]', and leave JAX_PLATFORMS unset."
    if host.backend == "cpu" and given.get("NPROC", str(host.cores)) != str(host.cores):
        yield f"NPROC is {given['NPROC']}: unset it, and a run gives XLA as many threads as suit {host.cores} cores."
    if host.cores < host.machine_cores:
        yield f"This process may use {host.cores} of {host.machine_cores} cores: ask taskset, the container or Slurm."
    if host.load > host.cores * (1 + BUSY):
        yield f"Others keep this machine busy (load {host.load} on {host.cores} cores): what was measured is too slow."
    if "backend_optimization_level=0" in given.get("XLA_FLAGS", ""):
        yield "XLA_FLAGS asks for unoptimised programs: unset it."
    if given.get("JAX_DISABLE_JIT", "0").lower() in ("1", "true"):
        yield "JAX_DISABLE_JIT is set, so nothing is compiled: unset it."
    if given.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() in ("0", "false"):
        yield "JAX_ENABLE_COMPILATION_CACHE is off, so every start compiles anew: unset it."
    elif not host.cache_writable:
        yield f"{host.cache} cannot be written, so every start compiles anew: set JAX_COMPILATION_CACHE_DIR."
    needed = found["make_run"]["memory_gib"]
    if host.memory_gib is not None and host.memory_gib < needed:
        less = max(int(host.memory_gib * 0.8), 1)
        yield f"make run needs {needed} GiB and {host.memory_gib} are free: give it ARGS='--memory-gb {less}'."
    if host.opengl is None:
        yield "No OpenGL works here, so pictures are drawn slowly: install libegl1 or libosmesa6, or leave it."
    slow = found["speed"]["sgemm_gflops"] * 1e9 / host.cores / OF_RATES.sgemm
    if host.backend == "cpu" and slow < SLOW:
        yield f"A core multiplies matrices at {slow:.0%} of the speed of ours: try fewer --seeds first."
