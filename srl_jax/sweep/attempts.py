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

NAME, LEASE = "attempts.jsonl", "lease"
JOBS = (("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID"), ("SLURM_JOB_ID",), ("RAY_JOB_ID",))  # first that is set
RESTARTS = "SLURM_RESTART_COUNT"

State = Literal["waiting", "running", "cut off", "failed", "done"]


@dataclass(frozen=True)
class Fate:
    """How a pack stands."""

    state: State
    attempts: int = 0
    error: str = ""  # the last line of what went wrong
    host: str = ""
    began: str = ""


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


def fate(directory: Path, pack: Path) -> Fate:
    """How a pack stands, by its files: done where it has a summary, running while its lease is held."""
    lines = read(directory)
    begun = [line for line in lines if "host" in line]
    last = begun[-1] if begun else {}
    ended = [line for line in lines if "exit" in line]
    about = {"attempts": len(begun), "host": last.get("host", ""), "began": last.get("at", "")}
    if (pack / "summary.json").exists():
        return Fate("done", **about)
    if (directory / LEASE).exists():
        return Fate("running", **about)
    if not begun:
        return Fate("waiting")
    if lines and "exit" in lines[-1]:
        state: State = "waiting" if lines[-1]["exit"] > 128 else "failed"
        return Fate(state, error=ended[-1].get("error", ""), **about)
    return Fate("cut off", error="it ended without a word: killed, or its machine was lost", **about)
