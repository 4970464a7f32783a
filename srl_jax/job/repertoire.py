"""A search for a repertoire: generations of MAP-Elites, with a checkpoint after each, and the files it leaves."""

import dataclasses
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as P

from srl_jax import machine
from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.ite import archive as repertoire
from srl_jax.ite import elites
from srl_jax.ite import walk as evaluate
from srl_jax.ite.elites import CELLS, Archive
from srl_jax.ite.settings import RepertoireSettings, check
from srl_jax.job import repertoire_files as files
from srl_jax.job.files import check_empty, claim, in_use, write_json, write_settings
from srl_jax.job.repertoire_files import METRICS, Search
from srl_jax.report import map as figure


class Status(NamedTuple):
    """What a display shows."""

    phase: str
    evaluations: int
    wanted: int
    filled: int
    best: float  # m in 5 s
    rate: float  # evaluations per second in this process
    elapsed: float  # s of search
    directory: Path  # where the files go


Listener = Callable[[Status], None]


def run(
    settings: RepertoireSettings,
    directory: Path,
    devices: int,
    *,
    exact: bool = True,
    resume: bool = False,
    listener: Listener = lambda status: None,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Any] | None:
    """Fills a map and leaves config.json, metrics.csv, map.npz, map.png and summary.json.

    Args:
        settings: what to do.
        directory: where the files go; new, or of a search to resume.
        devices: over how many devices a batch is laid.
        exact: the files go to `directory` or nowhere; otherwise a number is appended where the name is taken.
        resume: go on from the checkpoint in `directory`.
        listener: called after every generation.
        stopped: asked after every generation; once True, the search returns (it is saved already).

    Returns:
        The summary that was written, or None where the search was stopped (resume it).

    Raises:
        ValueError: the settings, the directory or the checkpoint is unusable; nothing has been written then.
    """
    check(settings)
    damage = damages.build(damage_names.canonical(settings.damage))
    if settings.batch % devices:
        raise ValueError(f"batch is {settings.batch}: give a multiple of the {devices} devices.")
    if exact and not resume:
        check_empty(directory)
    directory = directory if resume else claim(directory, exact=exact)
    with in_use(directory):
        search = files.read_checkpoint(directory / "checkpoint.npz") or files.beginning()
        done = len(search.history) * settings.batch
        write_settings(directory, {"repertoire": dataclasses.asdict(settings)}, devices, from_step=done)
        walker = _Walker(settings, damage, devices)
        listener(status(search, settings, "compiling", 0.0, directory))
        if not _search(search, settings, directory, walker, listener, stopped):
            return None
        return _finish(search, settings, directory, walker)


class _Walker:
    """The compiled evaluation of a batch on its devices, and how long it took."""

    def __init__(self, settings: RepertoireSettings, damage: damages.Damage, devices: int):
        mesh = evaluate.devices_mesh(devices)
        self.devices, self.batch = devices, settings.batch
        self.rows, self.damage = NamedSharding(mesh, P(evaluate.AXIS)), jax.device_put(damage, NamedSharding(mesh, P()))
        self.program = jax.jit(evaluate.make(mesh, settings.clock_hz))
        self.compile_seconds, self.seconds, self.evaluations = 0.0, 0.0, 0

    def compile(self) -> None:
        begin = time.perf_counter()
        gaits = jax.ShapeDtypeStruct((self.batch, elites.GENES), np.float32, sharding=self.rows)
        self.program = self.program.lower(self.damage, gaits).compile()
        self.compile_seconds = time.perf_counter() - begin

    def __call__(self, gaits: jax.Array) -> tuple[jax.Array, jax.Array]:
        # Through the host, a few kB: the devices that walk exchange nothing with each other.
        walked = jax.device_get(self.program(self.damage, jax.device_put(jax.device_get(gaits), self.rows)))
        return walked.fitness, walked.descriptor

    @property
    def rate(self) -> float:
        return self.evaluations / self.seconds if self.seconds else 0.0


def _search(
    search: Search,
    settings: RepertoireSettings,
    directory: Path,
    walker: _Walker,
    listener: Listener,
    stopped: Callable[[], bool],
) -> bool:
    """Runs the generations that are left; whether all are done."""
    key, wanted = jax.random.key(settings.seed), -(-settings.evaluations // settings.batch)
    if len(search.history) < wanted:
        walker.compile()
    for generation in range(len(search.history), wanted):
        if stopped():
            return False
        begin = time.perf_counter()
        # A generation's randomness depends on its number alone, so a resumed search goes the same way.
        turn = jax.random.fold_in(key, generation)
        search.archive, batch = elites.step(search.archive, walker, settings.batch, turn)
        row = measure(search.archive, batch, (generation + 1) * settings.batch)
        search.history = np.concatenate([search.history, row[None]])
        seconds = time.perf_counter() - begin
        search.seconds, walker.seconds = search.seconds + seconds, walker.seconds + seconds
        walker.evaluations += settings.batch
        files.write_checkpoint(directory / "checkpoint.npz", search)
        files.write_metrics(directory / "metrics.csv", search.history)
        listener(status(search, settings, "searching", walker.rate, directory))
    return True


def measure(archive: Archive, batch: elites.Batch, evaluations: int) -> np.ndarray:
    """A row of METRICS f64[6]: fitness in m; the QD score sums what is above 0; killed is a share of the batch."""
    fitness = np.asarray(archive.fitness, np.float64)
    found = fitness[np.isfinite(fitness)]
    best, mean = (found.max(), found.mean()) if len(found) else (np.nan, np.nan)
    killed = 1.0 - np.isfinite(batch.fitness).mean()
    return np.array([evaluations, len(found), best, mean, found.clip(min=0.0).sum(), killed])


def status(search: Search, settings: RepertoireSettings, phase: str, rate: float, directory: Path) -> Status:
    """What a display shows of a search."""
    row = search.history[-1] if len(search.history) else np.zeros(len(METRICS))
    return Status(phase, int(row[0]), settings.evaluations, int(row[1]), float(row[2]), rate, search.seconds, directory)


def _finish(search: Search, settings: RepertoireSettings, directory: Path, walker: _Walker) -> dict[str, Any]:
    """Writes the map, its picture and the summary; returns the summary."""
    results = found(search)
    about = dataclasses.asdict(settings) | results | {"command": command(settings)}
    repertoire.save(directory / "map.npz", search.archive, about)
    figure.save_map(search.archive, search.history, directory / "map.png")
    used = {
        "machine": platform.machine(),
        "device": jax.devices()[0].device_kind,
        "devices": walker.devices,
        "compile_seconds": round(walker.compile_seconds, 1),
        "evaluations_per_second": round(results["evaluations"] / search.seconds, 1),
        "peak_memory_gib": machine.peak_memory_gib(),
    }
    summary = results | {"settings": dataclasses.asdict(settings), "machine": used}
    write_json(directory / "summary.json", summary)
    return summary


def found(search: Search) -> dict[str, Any]:
    """What a search has come to; None for measures of a map in which no gait stays upright."""
    last = dict(zip(METRICS, search.history[-1].tolist(), strict=True))
    return {
        "evaluations": int(last["evaluations"]),
        "filled": int(last["filled"]),
        "coverage": last["filled"] / CELLS,
        **{name: last[name] if np.isfinite(last[name]) else None for name in METRICS[2:5]},
        "seconds": round(search.seconds, 1),
    }


def command(settings: RepertoireSettings) -> str:
    """The command line that gives these settings."""
    words = [f"--{name.replace('_', '-')} {value}" for name, value in dataclasses.asdict(settings).items()]
    return " ".join(["srl-jax repertoire", *words])
