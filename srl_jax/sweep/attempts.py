"""What became of each pack: a line for every attempt that began or ended, whoever made it.

Lines are appended whole by the one process that holds the pack's lease, so that nothing is lost when it is killed: an
attempt without an end is one that was cut off, or is under way.
"""

import json
import os
import socket
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from srl_jax.sweep import lease
from srl_jax.sweep.manifest import Pack

NAME, LEASE = "attempts.jsonl", "lease"
JOBS = (("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID"), ("SLURM_JOB_ID",))  # first that is set
RESTARTS = "SLURM_RESTART_COUNT"

State = Literal["waiting", "running", "cut off", "failed", "done"]


@dataclass(frozen=True)
class Fate:
    """How a pack stands."""

    state: State
    attempts: int = 0
    error: str = ""  # the last line of what went wrong; of a pack that is done, which of its lanes did
    host: str = ""
    began: str = ""  # when it was first begun


def job() -> str:
    """The engine's name for the task that this process is; empty outside of one."""
    for names in JOBS:
        if all(name in os.environ for name in names):
            return "_".join(os.environ[name] for name in names)
    return ""


def begin(directory: Path) -> None:
    """Records that an attempt begins, where, and as whose job."""
    restarts = int(os.environ.get(RESTARTS, "0") or 0)
    _append(directory, host=socket.gethostname(), pid=os.getpid(), job=job(), restarts=restarts)


def end(directory: Path, code: int, error: str = "") -> None:
    """Records how an attempt ended."""
    _append(directory, exit=code, error=error.strip().rpartition("\n")[2])


def _append(directory: Path, **facts: Any) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    line = json.dumps({"at": datetime.now(UTC).isoformat(timespec="seconds"), **facts}) + "\n"
    with (directory / NAME).open("ab", buffering=0) as file:
        file.write(line.encode())


def read(directory: Path) -> list[dict[str, Any]]:
    """All lines so far; one that a full disk cut short is left out."""
    try:
        lines = (directory / NAME).read_text().splitlines()
    except FileNotFoundError:
        return []
    found = []
    for line in lines:
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def fate(pack: Pack) -> Fate:
    """How a pack stands, by its files: done with a summary, running while somebody who lives holds its lease."""
    lines = read(pack.task)
    begun = [line for line in lines if "host" in line]
    if not begun:
        return Fate("done", error=_not_finite(pack)) if pack.done else Fate("waiting")
    about = {"attempts": len(begun), "host": begun[-1]["host"], "began": begun[0]["at"]}
    if pack.done:
        return Fate("done", error=_not_finite(pack), **about)
    if lease.lives(pack.task / LEASE):
        return Fate("running", **about)
    if "exit" not in lines[-1]:
        return Fate("cut off", error="it ended without a word: killed, or its machine was lost", **about)
    stopped = lines[-1]["exit"] > 128
    return Fate("waiting" if stopped else "failed", error=lines[-1]["error"], **about)


def _not_finite(pack: Pack) -> str:
    """Names the lanes of a pack that is done which have failed."""
    try:
        lanes = json.loads((pack.directory / "summary.json").read_text()).get("nonfinite_lanes", [])
    except ValueError:
        return "its summary.json cannot be read"
    if not lanes:
        return ""
    first = lanes[0]  # by name: its number in the merge is another one where there is a grid
    name = " ".join(filter(None, (first["algo"], first["variant"], f"seed {first['seed']}", first["damage"])))
    more = f", and {len(lanes) - 1} more" if len(lanes) > 1 else ""
    return f"not finite from step {first['step']} on: {name}{more}"
