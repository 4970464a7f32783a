"""The verb ``sweep``: ``srl-jax sweep --task p2p --seeds 100 --out sweeps/big --engine slurm`` trains pack by pack."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import tyro

from srl_jax import machine
from srl_jax.cli import run as run_verb
from srl_jax.cli.ending import leave
from srl_jax.cli.grid import combinations
from srl_jax.cli.signals import StopSignals
from srl_jax.cli.sweep_display import merge, show_status, told
from srl_jax.job import plan as plans
from srl_jax.sweep import local, manifest, slurm
from srl_jax.sweep.manifest import Point, Sweep
from srl_jax.sweep.task import Order

if TYPE_CHECKING:
    from srl_jax.sweep.cost import Cost

APART = ("task", "steps", "train", "evaluation")  # settings in which the lanes of one table do not differ
OF_THE_ENGINE = ("engine", "cpus", "jobs", "retries", "time", "partition", "sbatch", "ray_address")


@dataclass(frozen=True)
class Arguments:
    """Train many lanes as packs, each an ordinary run that resumes, side by side on a machine or a cluster.

    Every option of `srl-jax run` may be given too: it says what the lanes are.
    """

    out: str
    """Directory of the sweep; on a cluster one that all its machines see."""
    engine: Literal["local", "slurm", "ray"] = "local"
    """local: processes of this machine; slurm: an array of jobs; ray: tasks of a Ray cluster."""
    grid: tuple[str, ...] = ()
    """Settings to combine that are not swept inside one program: name=value;value, such as srl.hidden=64,64;128,128."""
    pack_lanes: str = "auto"
    """Lanes of a pack: a number, or auto (half an hour's worth, as far as the memory allows)."""
    cpus: int = 0
    """Cores of a task; 0: on a cluster 4, on one machine what --jobs leaves to each."""
    jobs: int = 0
    """Tasks at once; 0: on one machine one, on a cluster as many as it likes."""
    retries: int = 5
    """Further attempts at a pack that fails or is killed."""
    time: str = "2:00:00"
    """Slurm's time limit of a task; it saves two minutes before."""
    partition: str = ""
    """Slurm's partition."""
    sbatch: tuple[str, ...] = ()
    """Further options of sbatch, such as --sbatch=--account=x."""
    ray_address: str = ""
    """Of a Ray cluster; empty: one is started here."""
    dry_run: bool = False
    """Print the plan and the job script; write nothing."""
    plan_only: bool = False
    """Write the manifest and start nothing: another engine hands out --run-pack (docs/sweeps.md)."""
    resume: bool = False
    """Go on with the sweep in --out: its packs that are not done."""
    status: bool = False
    """How the packs of the sweep in --out stand."""
    watch: bool = False
    """With --status: again and again, until all have ended."""
    merge: bool = False
    """Write merged/ from the packs that are done."""
    cancel: bool = False
    """Cancel what Slurm still has of the sweep in --out; tasks save first."""
    run_pack: int = -1
    """What a task does: train one pack, from its checkpoint if there is one."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and does what it says; exits as `leave` does."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    asked, rest = parse(argv)
    if not any((asked.run_pack >= 0, asked.resume, asked.status, asked.merge, asked.cancel)):
        return begin(asked, rest)
    if rest:
        raise ValueError(f"{' '.join(rest)}: the sweep in {asked.out} has its settings; leave them out.")
    sweep = manifest.read(Path(asked.out).absolute())
    if asked.run_pack >= 0:
        from srl_jax.cli.pack import run_pack

        return run_pack(sweep, asked.run_pack)
    if asked.status:
        return show_status(sweep, watch=asked.watch)
    if asked.merge:
        return merge(sweep)
    if asked.cancel:
        print(f"Cancelled: {' '.join(slurm.cancel(sweep)) or 'Slurm has no job of this sweep.'}")
        return 0
    return start(sweep, parse(argv, sweep.engine)[0])


def parse(argv: list[str], stored: Mapping[str, Any] = MappingProxyType({})) -> tuple[Arguments, list[str]]:
    """The options of a sweep, in place of those that its manifest has stored, and what is left for its runs."""
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()
    }
    default: Any = Arguments(out="", **values) if values else None
    return tyro.cli(Arguments, args=argv, default=default, prog="srl-jax sweep", return_unknown_args=True)


def begin(asked: Arguments, rest: list[str]) -> int:
    """Plans a new sweep, and does it, or as much of that as is asked for."""
    from srl_jax.sweep import cost

    sweep = plan(asked, rest)
    found = cost.cost(sweep, cores(asked))
    for line in cost.lines(found, cores(asked), at_once(asked, len(sweep))):
        print(line)
    if asked.dry_run:
        for number in dict.fromkeys((0, len(sweep) - 1)):
            print(f"pack {number:05d}: {sweep.pack(number).command}")
        if asked.engine == "slurm":
            print(slurm.array_script(sweep, slurm_options(asked, found.pack_bytes)))
        return 0
    check(sweep, asked, found)
    manifest.write(sweep)
    return 0 if asked.plan_only else start(sweep, asked)


def plan(asked: Arguments, rest: list[str]) -> Sweep:
    """The sweep that a command line describes: its points, in packs."""
    from srl_jax.sweep import cost

    points, cpus = [], cores(asked)
    for label, arguments in combinations(asked.grid, rest):
        if not any(word.partition("=")[0] == "--devices" for word in arguments):
            arguments = [*arguments, "--devices", str(cpus)]  # the same on every node, so that numbers are too
        _, config = run_verb.parse(list(arguments))
        plans.check(config)
        if "train" in plans.parse_teachers(config):
            raise ValueError(
                "behaviour is train: every pack would train it anew; train it once and give its directory."
            )
        points.append(Point(label, tuple(arguments), config))
    for name in APART:
        if len({str(getattr(point.config, name)) for point in points}) > 1:
            raise ValueError(f"grid has {name}: its points could not stand in one table; make a sweep of each.")
    if asked.pack_lanes == "auto":
        limit = min(point.config.memory_gb for point in points)
        size = cost.best_pack(points, cpus, limit, asked.jobs)
    elif asked.pack_lanes.isdecimal():
        size = int(asked.pack_lanes)
    else:
        raise ValueError(f"pack_lanes is {asked.pack_lanes!r}: give auto or a number.")
    engine = {name: getattr(asked, name) for name in OF_THE_ENGINE}
    return Sweep(Path(asked.out).absolute(), manifest.split(points, size), engine)


def cores(asked: Arguments) -> int:
    """Of a task."""
    return asked.cpus or (4 if asked.engine != "local" else max(1, machine.cores() // max(1, asked.jobs)))


def at_once(asked: Arguments, packs: int) -> int:
    """Tasks that the arithmetic reckons with."""
    return max(1, min(packs, asked.jobs or (1 if asked.engine == "local" else packs)))


def slurm_options(asked: Arguments, pack_bytes: int) -> slurm.Options:
    """What Slurm is asked for; of memory a quarter more than the arithmetic of a pack says."""
    memory_mb = -(-pack_bytes * 5 // 4 // 2**20)
    return slurm.Options(cores(asked), asked.time, asked.partition, asked.jobs, memory_mb, asked.retries, asked.sbatch)


def check(sweep: Sweep, asked: Arguments, found: "Cost") -> None:
    """Raises ValueError where the engine could not do it."""
    from srl_jax.sweep import cost

    limit = min(point.config.memory_gb for point in sweep.points)
    if found.pack_bytes > limit * 2**30:
        needed = found.pack_bytes / 2**30
        raise ValueError(f"pack_lanes is {asked.pack_lanes}: a pack needs {needed:.1f} GiB, memory_gb is {limit:g}.")
    if asked.engine == "local":
        local.core_sets(cores(asked), max(1, asked.jobs))
    if asked.engine == "slurm":
        slurm.check(slurm_options(asked, found.pack_bytes))
        slurm.check_shared(sweep.directory)
        share = max(min(1.0, x.config.train.checkpoint_every / x.config.steps) for x in sweep.points)
        needed = cost.START + found.pack_seconds * share + slurm.WARNING
        if slurm.seconds(asked.time) < needed:
            raise ValueError(
                f"time is {asked.time}: a pack reaches its first checkpoint after some {needed / 60:.0f} min; "
                "give it longer, or smaller packs."
            )


def start(sweep: Sweep, asked: Arguments) -> int:
    """Hands what is not done to the engine; 0 where all is done, or submitted."""
    waiting = sweep.unfinished()
    if asked.engine == "slurm" and waiting:
        from srl_jax.sweep import cost

        options = slurm_options(asked, cost.cost(sweep, cores(asked)).pack_bytes)
        slurm.check(options)
        jobs = slurm.submit(sweep, waiting, options)
        print(f"Submitted {len(waiting)} packs as {' '.join(jobs[:-1])}, their merge as {jobs[-1]}.")
        print(f"Look at them with: srl-jax sweep --out {sweep.directory} --status")
        return 0
    if waiting:
        stop = StopSignals()
        order = Order(sweep, cores(asked), max(1, asked.jobs), asked.retries, stop.requested, told)
        if asked.engine == "ray":
            from srl_jax.sweep import ray

            ray.run(order, asked.ray_address)
        else:
            local.run(order)
        if stop.number:
            print(f"Stopped and saved. Go on with: srl-jax sweep --out {sweep.directory} --resume")
            return 128 + stop.number
    return merge(sweep)
