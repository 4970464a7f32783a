"""Compiled programs that packs share: one folder for each kind of processor, filled by the first pack, kept readable.

jax writes entries that are not whole when a process is killed; it then warns and compiles at every start. What all
packs would compile at once, one of them compiles while the others wait for it.
"""

import contextlib
import hashlib
import re
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

from srl_jax.sweep import lease

WAIT = 600.0  # s; nobody waits longer for another's compiling
POLL = 1.0
ZSTD = b"\x28\xb5\x2f\xfd"  # how such an entry begins
COMPLAINT = "Error reading persistent compilation cache entry"


def of_this_processor(root: Path, info: Path = Path("/proc/cpuinfo")) -> Path:
    """The folder for programs of this kind of processor: its name, and what it can do, made short."""
    try:
        text = info.read_text()
    except OSError:
        return root / "unknown"
    names = re.findall(r"^model name\s*:\s*(.+)$", text, re.M)
    flags = re.findall(r"^(?:flags|Features)\s*:\s*(.+)$", text, re.M)
    name = re.sub(r"[^A-Za-z0-9]+", "-", names[0]).strip("-").lower() if names else "unknown"
    return root / f"{name}-{hashlib.sha256(' '.join(flags[:1]).encode()).hexdigest()[:8]}"


@contextlib.contextmanager
def warmed(folder: Path, name: str, *, wait: float = WAIT) -> Iterator[bool]:
    """Lets one process compile a program while the others wait until it has.

    Args:
        folder: from `of_this_processor`.
        name: of the program; packs of one shape share one.
        wait: s, after which one goes on whatever the other does.

    Yields:
        Whether this process is the one; the block should last as long as its compiling.
    """
    done, claim = folder / f"{name}.warm", folder / f"{name}.warming"
    until = time.monotonic() + wait
    while not done.exists() and time.monotonic() < until:
        try:
            with lease.held(claim, beat=2.0, patience=20.0):
                if done.exists():
                    break
                yield True
                done.touch()
                return
        except lease.HeldError:
            time.sleep(POLL)
    yield False


def mend(folder: Path) -> list[str]:
    """Removes entries that cannot be read, so that they are written anew; returns their names."""
    removed = []
    for path in sorted(folder.glob("*-cache")):
        if not _whole(path):
            path.unlink(missing_ok=True)
            removed.append(path.name)
    return removed


def _whole(path: Path) -> bool:
    """Whether an entry can be unpacked; what another Python has packed with zstd is not looked into."""
    data = path.read_bytes()
    if data[:4] == ZSTD:
        return True
    try:
        zlib.decompress(data)
    except zlib.error:
        return False
    return True
