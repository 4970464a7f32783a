"""A lease: a file that its owner keeps touching, so that locks hold where a file system has none (NFS).

No clock is compared with another machine's. Whoever finds a lease watches it: if it is not touched for `patience`
seconds its owner is dead, and one of those who saw that takes it over. The owner looks before every touch whether the
lease is still its own.
"""

import contextlib
import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

UNREADABLE = "unreadable"  # stands for the token of a lease that has none
BEAT, PATIENCE = 10.0, 90.0  # s; NFS may show what others wrote up to a minute late


class HeldError(RuntimeError):
    """A lease is in the hands of somebody who lives."""


@contextlib.contextmanager
def held(path: Path, *, beat: float = BEAT, patience: float = PATIENCE) -> Iterator[threading.Event]:
    """Holds a lease for the length of the block; yields an event that is set if it is lost.

    Args:
        path: the file.
        beat: seconds from one touch to the next.
        patience: seconds without a touch after which an owner counts as dead; several beats.

    Raises:
        HeldError: somebody else holds it; the message says who.
    """
    token = uuid.uuid4().hex
    acquire(path, token, patience)
    done, lost = threading.Event(), threading.Event()

    def touch() -> None:
        while not done.wait(beat):
            try:
                if _read(path).get("token") != token:
                    return lost.set()
                os.utime(path)
            except FileNotFoundError:
                return lost.set()
            except OSError:  # the file server is away for a while; others wait for patience
                continue
        return None

    beating = threading.Thread(target=touch, daemon=True)
    beating.start()
    try:
        yield lost
    finally:
        done.set()
        beating.join()
        if owner(path).get("token") == token:
            path.unlink(missing_ok=True)


def acquire(path: Path, token: str, patience: float) -> None:
    """Makes the lease one's own, if need be after having watched it for `patience` seconds.

    Raises:
        HeldError: its owner lives.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    while not _create(path, token):
        found = owner(path)
        if not found:
            time.sleep(min(0.05, patience))  # it is being written, or was given back just now
            unreadable = not owner(path) and path.exists() and _untouched(path, patience)
            if unreadable and _bury(path, UNREADABLE, token, patience):
                return
            continue
        if not _died_here(found) and not _untouched(path, patience):
            if owner(path).get("token") != found["token"]:
                continue  # it was given back or taken over while it was watched
            raise HeldError(f"{path.parent} is in use by {found['host']}, process {found['pid']}.")
        if _bury(path, found["token"], token, patience):
            return


def owner(path: Path) -> dict[str, Any]:
    """Who holds a lease: token, host, pid, job; empty if nobody does."""
    try:
        return _read(path)
    except OSError:
        return {}


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text())
    except ValueError:
        return {}
    return found if isinstance(found, dict) and "token" in found else {}


def lives(path: Path, patience: float = PATIENCE) -> bool:
    """Whether a lease is held by somebody who lives, as far as one look tells.

    Its last touch is compared with one that is made now, so that both are by the clock of the file server.
    """
    found = owner(path)
    if not found or _died_here(found):
        return False
    probe = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        probe.touch()
        return probe.stat().st_mtime - path.stat().st_mtime < patience
    except FileNotFoundError:
        return False  # it was given back just now
    finally:
        probe.unlink(missing_ok=True)


def _text(token: str) -> str:
    about = {"host": socket.gethostname(), "pid": os.getpid(), "began": _birth(os.getpid())}
    return json.dumps({"token": token, **about})


def _create(path: Path, token: str) -> bool:
    # A link appears whole or not at all, on NFS too, where O_EXCL once did not hold.
    own = path.with_name(f"{path.name}.{token}")
    own.write_text(_text(token))
    try:
        os.link(own, path)
    except FileExistsError:
        return False
    finally:
        own.unlink()
    return True


def _bury(path: Path, dead: str, token: str, patience: float) -> bool:
    """Takes the lease of a dead owner over; of several who try, one does. False: look again."""
    grave = path.with_name(f"{path.name}.{dead}.dead")
    if not _create(grave, token):
        if not _untouched(grave, patience):
            return False
        grave.unlink(missing_ok=True)  # whoever dug it died in it
        return False
    try:
        if owner(path).get("token", UNREADABLE) != dead:
            return False
        own = path.with_name(f"{path.name}.{token}")
        own.write_text(_text(token))
        own.replace(path)
        return True
    finally:
        grave.unlink(missing_ok=True)


def _untouched(path: Path, patience: float) -> bool:
    """Whether nobody touches or replaces a file for so long; looks several times."""
    before, until = _state(path), time.monotonic() + patience
    while time.monotonic() < until:
        time.sleep(patience / 20)
        if _state(path) != before:
            return False
    return True


def _state(path: Path) -> tuple[int, int] | None:
    try:
        with path.open() as file:  # opening asks the server, where stat may answer from memory
            found = os.fstat(file.fileno())
        return found.st_mtime_ns, found.st_ino
    except OSError:
        return None


def _died_here(found: dict[str, Any]) -> bool:
    """Whether the owner was a process of this machine that is no more: then there is nothing to wait for."""
    if found.get("host") != socket.gethostname() or not Path("/proc/self").exists():
        return False
    return not Path(f"/proc/{found['pid']}").exists() or _birth(int(found["pid"])) != found.get("began")


def _birth(pid: int) -> str:
    """When a process began, in ticks since the system did; empty where that is not told."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""
