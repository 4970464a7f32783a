"""The engine of a Slurm cluster: a plain array script for `sbatch`, and a merge when every task has ended."""

import re
import shlex
import shutil
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from srl_jax.sweep import scripts, task
from srl_jax.sweep.manifest import Sweep

WARNING = 120  # s before the time limit at which a task is asked to save
LOCAL = ("/tmp/", "/var/tmp/", "/dev/shm/", "/run/")  # of every machine its own
TASKS = 1_000  # of one array, where the cluster does not say (its default MaxArraySize is 1001)


@dataclass(frozen=True)
class Options:
    """What the cluster is asked for."""

    cpus: int
    time: str
    partition: str = ""
    at_once: int = 0  # tasks; 0: as many as the cluster likes
    memory_mb: int = 0  # of a task; 0: the cluster's default
    retries: int = 5
    extra: tuple[str, ...] = ()  # further options of sbatch


def array_script(sweep: Sweep, options: Options) -> str:
    """The script of the array; its argument is the number of the first pack of an array."""
    lines = {
        "job-name": f"srl-{sweep.directory.name}",
        "cpus-per-task": str(options.cpus),
        "time": options.time,
        "output": f"{sweep.directory / 'slurm' / '%A_%a.out'}",
    }
    if options.memory_mb:
        lines["mem"] = f"{options.memory_mb}M"
    return scripts.PACK.format(
        options=_options(lines, options),
        warning=WARNING,
        command=shlex.join(task.PROGRAM),
        directory=shlex.quote(str(sweep.directory)),
        retries=options.retries,
    )


def merge_script(sweep: Sweep, options: Options) -> str:
    """The script of the job that merges."""
    lines = {
        "job-name": f"srl-{sweep.directory.name}-merge",
        "cpus-per-task": "1",
        "time": "30:00",
        "output": f"{sweep.directory / 'slurm' / 'merge-%j.out'}",
    }
    return scripts.MERGE.format(
        options=_options(lines, options),
        command=shlex.join(task.PROGRAM),
        directory=shlex.quote(str(sweep.directory)),
        retries=options.retries,
    )


def _options(lines: dict[str, str], options: Options) -> str:
    text = [f"#SBATCH --{name}={value}" for name, value in lines.items()]
    text += [f"#SBATCH --partition={options.partition}"] if options.partition else []
    return "\n".join([*text, *(f"#SBATCH {extra}" for extra in options.extra)])


def arrays(numbers: Sequence[int], most: int) -> list[tuple[int, str]]:
    """The packs as arrays of at most so many tasks: (first pack, ids relative to it in sbatch's notation)."""
    found: list[tuple[int, str]] = []
    rest = sorted(numbers)
    while rest:
        first = rest[0]
        own = [number for number in rest if number - first < most]
        rest = rest[len(own) :]
        found.append((first, _ranges([number - first for number in own])))
    return found


def _ranges(numbers: Sequence[int]) -> str:
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ",".join(str(low) if low == high else f"{low}-{high}" for low, high in spans)


def submit(sweep: Sweep, numbers: Sequence[int], options: Options) -> list[str]:
    """Hands the packs and, after them, the merge to Slurm; returns the numbers of the jobs, the merge's last.

    Raises:
        ValueError: jobs of the sweep are still in the queue, or Slurm refuses; then the message is its own.
    """
    if there := submitted(sweep):
        raise ValueError(f"{sweep.directory} has jobs in the queue ({' '.join(there)}): wait for them, or --cancel.")
    folder = sweep.directory / "slurm"
    folder.mkdir(exist_ok=True)
    (folder / "pack.sh").write_text(array_script(sweep, options))
    (folder / "merge.sh").write_text(merge_script(sweep, options))
    limit = f"%{options.at_once}" if options.at_once else ""
    jobs = [
        _sbatch(f"--array={ids}{limit}", str(folder / "pack.sh"), str(first))
        for first, ids in arrays(numbers, largest_array())
    ]
    merge = _sbatch(f"--dependency=afterany:{':'.join(jobs)}", str(folder / "merge.sh"))
    with (folder / "jobs").open("a") as file:
        file.writelines(f"{job}\n" for job in [*jobs, merge])
    return [*jobs, merge]


def submitted(sweep: Sweep) -> list[str]:
    """The jobs of the sweep that Slurm has not yet finished with."""
    path = sweep.directory / "slurm" / "jobs"
    own = set(path.read_text().split()) if path.exists() else set()
    known = _said(["squeue", "--noheader", "--me", "--format=%F"]).split() if own else []
    return sorted(own.intersection(known), key=int)


def cancel(sweep: Sweep) -> list[str]:
    """Cancels what Slurm has not yet finished with; tasks save first."""
    jobs = submitted(sweep)
    if jobs:
        _said(["scancel", "--quiet", *jobs])
    return jobs


def check(options: Options) -> None:
    """Raises ValueError where there is no Slurm, no such partition, or a time that it does not understand."""
    if shutil.which("sbatch") is None:
        raise ValueError("engine is slurm: no sbatch is on the PATH of this machine; log in to one that submits jobs.")
    if seconds(options.time) <= WARNING:
        raise ValueError(f"time is {options.time}: a task is asked to save {WARNING} s before it ends; give it longer.")
    if options.partition:
        known = [name.rstrip("*") for name in _said(["sinfo", "--noheader", "--format=%P"]).split()]
        if options.partition not in known:
            raise ValueError(f"partition is {options.partition!r}: this cluster has {', '.join(known) or 'none'}.")


def check_shared(directory: Path) -> None:
    """Raises ValueError where the directory lies on this machine alone while others would work on it."""
    path = str(directory.absolute())
    local = next((root for root in LOCAL if path.startswith(root)), None)
    hosts = set(_said(["sinfo", "--noheader", "--Node", "--format=%n"]).split())
    others = sorted(host for host in hosts if host.partition(".")[0] != socket.gethostname().partition(".")[0])
    if local and others:
        raise ValueError(
            f"out is {directory}: {local} is this machine's own, and {others[0]} would not see it; choose a directory "
            "that all nodes share."
        )


def seconds(text: str) -> int:
    """Slurm's time: minutes, minutes:seconds, hours:minutes:seconds, days-hours[:minutes[:seconds]].

    Raises:
        ValueError: it is none.
    """
    match = re.fullmatch(r"(?:(\d+)-)?(\d+)(?::(\d+))?(?::(\d+))?", text)
    if not match:
        raise ValueError(f"time is {text!r}: give minutes, hours:minutes:seconds or days-hours.")
    days, *rest = match.groups()
    parts = [int(part) for part in rest if part is not None]
    if days is not None:
        hours, minutes, second = [*parts, 0, 0][:3]
        return ((int(days) * 24 + hours) * 60 + minutes) * 60 + second
    if len(parts) == 3:
        return (parts[0] * 60 + parts[1]) * 60 + parts[2]
    return parts[0] * 60 + (parts[1] if len(parts) == 2 else 0)


def largest_array() -> int:
    """How many tasks this cluster takes in one array."""
    try:
        found = re.search(r"MaxArraySize\s*=\s*(\d+)", _said(["scontrol", "show", "config"]))
    except ValueError:
        return TASKS
    return int(found.group(1)) - 1 if found else TASKS


def _sbatch(*arguments: str) -> str:
    return _said(["sbatch", "--parsable", *arguments]).strip().partition(";")[0]


def _said(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(f"{command[0]}: {(done.stderr or done.stdout).strip() or f'exit code {done.returncode}'}")
    return done.stdout
