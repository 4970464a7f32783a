"""The verb ``sweep``: ``srl-jax sweep --task p2p --seeds 100 --out sweeps/big --engine slurm`` trains pack by pack."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from srl_jax import machine
from srl_jax.cli import run as run_verb
from srl_jax.cli.ending import leave
from srl_jax.cli.grid import combinations
from srl_jax.cli.signals import StopSignals
from srl_jax.cli.sweep_display import merge, show_status, told
from srl_jax.sweep import local, manifest, slurm
from srl_jax.sweep.manifest import Point, Sweep


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
    asked, rest = tyro.cli(Arguments, args=argv, prog="srl-jax sweep", return_unknown_args=True)
    directory = Path(asked.out)
    verbs = ("resume", "status", "merge", "cancel")
    if asked.run_pack >= 0 or any(getattr(asked, verb) for verb in verbs):
        if rest:
            raise ValueError(f"{' '.join(rest)}: the sweep in {directory} has its settings; leave them out.")
        sweep = manifest.read(directory)
        if asked.run_pack >= 0:
            from srl_jax.cli.pack import run_pack

            return run_pack(sweep, asked.run_pack)
        if asked.status:
            return show_status(sweep, watch=asked.watch)
        if asked.merge:
            return merge(sweep)
        if asked.cancel:
            print(f"Cancelled: {' '.join(slurm.cancel(sweep)) or 'nothing was submitted'}")
            return 0
        return start(sweep, asked)
    sweep = plan(asked, rest)
    if asked.dry_run:
        return dry_run(sweep, asked)
    check(sweep, asked)
    manifest.write(sweep)
    return 0 if asked.plan_only else start(sweep, asked)


def plan(asked: Arguments, rest: list[str]) -> Sweep:
    """The sweep that a command line describes: its points in packs, with the arithmetic printed."""
    from srl_jax.sweep import cost

    points, cpus = [], cores(asked)
    for label, arguments in combinations(asked.grid, rest):
        if not any(word.partition("=")[0] == "--devices" for word in arguments):
            arguments = [*arguments, "--devices", str(cpus)]  # the same on every node, so that numbers are too
        _, config = run_verb.parse(list(arguments))
        if config.behaviour == "train":
            raise ValueError(
                "behaviour is train: every pack would train it anew; train it once and give its directory."
            )
        points.append(Point(label, tuple(arguments), config))
    chosen = tuple(points)
    if asked.pack_lanes != "auto" and not asked.pack_lanes.isdecimal():
        raise ValueError(f"pack_lanes is {asked.pack_lanes!r}: give auto or a number.")
    if asked.pack_lanes == "auto":
        size = cost.best_pack(chosen, cpus, min(point.config.memory_gb for point in chosen), asked.jobs)
    else:
        size = int(asked.pack_lanes)
    sweep = Sweep(Path(asked.out).absolute(), manifest.split(chosen, size))
    for line in cost.lines(cost.cost(sweep, cpus), cpus, at_once(asked, len(sweep))):
        print(line)
    return sweep


def cores(asked: Arguments) -> int:
    """Of a task."""
    return asked.cpus or (4 if asked.engine != "local" else max(1, machine.cores() // max(1, asked.jobs)))


def at_once(asked: Arguments, packs: int) -> int:
    """Tasks that the arithmetic reckons with."""
    return max(1, min(packs, asked.jobs or (1 if asked.engine == "local" else packs)))


def slurm_options(asked: Arguments, memory_bytes: int = 0) -> slurm.Options:
    """What Slurm is asked for."""
    memory_mb = -(-memory_bytes * 5 // 4 // 2**20)
    return slurm.Options(
        cores(asked), asked.time, asked.partition, asked.jobs, memory_mb, asked.retries, tuple(asked.sbatch)
    )


def check(sweep: Sweep, asked: Arguments) -> None:
    """Raises ValueError where the engine could not do it."""
    from srl_jax.sweep import cost

    found = cost.cost(sweep, cores(asked))
    largest = min(point.config.memory_gb for point in sweep.points)
    if found.pack_bytes > largest * 2**30:
        raise ValueError(
            f"pack_lanes is {asked.pack_lanes}: a pack needs {found.pack_bytes / 2**30:.1f} GiB, "
            f"memory_gb is {largest:g}."
        )
    if asked.engine == "local":
        local.core_sets(cores(asked), max(1, asked.jobs))
    if asked.engine == "slurm":
        slurm.check(slurm_options(asked))
        slurm.check_shared(sweep.directory)
        point = max(sweep.points, key=lambda point: cost.seconds(point, found.pack_lanes, cores(asked)))
        share = point.config.train.checkpoint_every / point.config.steps
        needed = cost.START + found.pack_seconds * min(1.0, share) + slurm.WARNING
        if slurm.seconds(asked.time) < needed:
            raise ValueError(
                f"time is {asked.time}: a pack reaches its first checkpoint after some {needed / 60:.0f} min; "
                "give it longer, or smaller packs."
            )


def dry_run(sweep: Sweep, asked: Arguments) -> int:
    """Prints what would be done."""
    for pack in (sweep.pack(0), sweep.pack(len(sweep) - 1))[: len(sweep)]:
        print(f"pack {pack.number:05d}: {pack.command}")
    if asked.engine == "slurm":
        print(slurm.array_script(sweep, slurm_options(asked)))
    return 0


def start(sweep: Sweep, asked: Arguments) -> int:
    """Hands what is not done to the engine; 0 where all is done, or submitted."""
    waiting = local.unfinished(sweep)
    if asked.engine == "slurm" and waiting:
        slurm.check(slurm_options(asked))
        jobs = slurm.submit(sweep, waiting, slurm_options(asked))
        print(f"Submitted {len(waiting)} packs as {' '.join(jobs[:-1])}, their merge as {jobs[-1]}.")
        print(f"Look at them with: srl-jax sweep --out {sweep.directory} --status")
        return 0
    if waiting:
        stop = StopSignals()
        engine = _ray(asked) if asked.engine == "ray" else local.run
        engine(
            sweep, cpus=cores(asked), jobs=max(1, asked.jobs), retries=asked.retries, stopped=stop.requested, told=told
        )
        if stop.number:
            print(f"Stopped and saved. Go on with: srl-jax sweep --out {sweep.directory} --resume")
            return 128 + stop.number
    return merge(sweep)


def _ray(asked: Arguments):
    from functools import partial

    from srl_jax.sweep import ray

    return partial(ray.run, address=asked.ray_address)
