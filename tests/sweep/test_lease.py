"""Leases: one owner, whoever claims; the dead are taken over, once, and the living never."""

import json
import os
import socket
import subprocess
import sys
import threading
import time

import pytest

from srl_jax.sweep import lease

QUICK = {"beat": 0.05, "patience": 0.6}
HOLDER = """
import sys, time
from pathlib import Path
from srl_jax.sweep import lease
with lease.held(Path(sys.argv[1]), beat=0.05, patience=0.6):
    print("held", flush=True)
    time.sleep(60)
"""


def stranger(path, host="elsewhere", pid=1):
    """A lease of another machine, which nobody of here can ask whether it lives."""
    path.write_text(json.dumps({"token": f"of-{host}", "host": host, "pid": pid, "began": ""}))


def test_a_lease_is_held_and_given_back(tmp_path):
    path = tmp_path / "folder" / "lease"
    with lease.held(path, **QUICK) as lost:
        assert lease.owner(path)["pid"] == os.getpid() and lease.owner(path)["host"] == socket.gethostname()
        assert not lost.is_set()
    assert list(path.parent.iterdir()) == []


def test_it_is_given_back_by_an_error_too(tmp_path):
    with pytest.raises(RuntimeError, match="mine"), lease.held(tmp_path / "lease", **QUICK):
        raise RuntimeError("mine")
    assert not (tmp_path / "lease").exists()


def test_who_lives_keeps_it(tmp_path):
    with lease.held(tmp_path / "lease", **QUICK):
        with pytest.raises(lease.HeldError, match=rf"in use by {socket.gethostname()}, process {os.getpid()}"):
            lease.acquire(tmp_path / "lease", "another", 0.6)
        assert lease.owner(tmp_path / "lease")["token"] != "another"


def test_a_process_of_this_machine_that_was_killed_is_not_waited_for(tmp_path):
    path = tmp_path / "lease"
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout and process.stdout.readline() == "held\n"
        process.kill()
    with lease.held(path, beat=0.05, patience=3600.0):
        assert lease.owner(path)["pid"] == os.getpid()


def test_another_process_with_the_number_of_the_dead_one_is_not_taken_for_it(tmp_path):
    path = tmp_path / "lease"
    about = {"token": "old", "host": socket.gethostname(), "pid": os.getpid(), "began": "another time"}
    path.write_text(json.dumps(about))
    with lease.held(path, beat=0.05, patience=3600.0):
        assert lease.owner(path)["token"] != "old"


def test_a_stranger_who_is_silent_for_long_enough_is_dead(tmp_path):
    stranger(tmp_path / "lease")
    began = time.monotonic()
    with lease.held(tmp_path / "lease", **QUICK):
        assert time.monotonic() - began >= QUICK["patience"]
        assert lease.owner(tmp_path / "lease")["host"] == socket.gethostname()


def test_a_stranger_who_speaks_lives(tmp_path):
    path, done = tmp_path / "lease", threading.Event()
    stranger(path)

    def speak():
        while not done.wait(0.05):
            os.utime(path)

    speaking = threading.Thread(target=speak)
    speaking.start()
    try:
        with pytest.raises(lease.HeldError, match="in use by elsewhere, process 1"):
            lease.acquire(path, "mine", 0.6)
    finally:
        done.set()
        speaking.join()


def test_one_of_many_who_see_the_death_takes_over(tmp_path):
    path = tmp_path / "lease"
    stranger(path)
    inside, most, refused = [], [], []

    def claim():
        try:
            with lease.held(path, **QUICK):
                inside.append(1)
                most.append(len(inside))
                time.sleep(1.5)
                inside.pop()
        except lease.HeldError:
            refused.append(1)

    claims = [threading.Thread(target=claim) for _ in range(8)]
    for thread in claims:
        thread.start()
    for thread in claims:
        thread.join()
    assert max(most) == 1 and len(most) + len(refused) == 8 and refused


def test_who_lost_it_is_told_and_does_not_take_the_new_owners_away(tmp_path):
    path = tmp_path / "lease"
    with lease.held(path, **QUICK) as lost:
        path.unlink()
        stranger(path)
        assert lost.wait(5.0)
    assert lease.owner(path)["host"] == "elsewhere"


def test_whoever_died_while_taking_over_is_no_obstacle(tmp_path):
    stranger(tmp_path / "lease")
    stranger(tmp_path / "lease.of-elsewhere.dead", host="third")
    with lease.held(tmp_path / "lease", **QUICK):
        assert lease.owner(tmp_path / "lease")["host"] == socket.gethostname()


def test_a_lease_that_is_no_longer_readable_is_taken_after_patience(tmp_path):
    (tmp_path / "lease").write_text("{")
    with lease.held(tmp_path / "lease", **QUICK):
        assert lease.owner(tmp_path / "lease")["pid"] == os.getpid()


def test_a_file_server_that_is_away_for_a_while_takes_no_lease(tmp_path, monkeypatch):
    with lease.held(tmp_path / "lease", **QUICK) as lost:
        with monkeypatch.context() as away:
            away.setattr(lease, "_read", lambda path: (_ for _ in ()).throw(OSError(5, "Input/output error")))
            assert not lost.wait(0.3)
        before = (tmp_path / "lease").stat().st_mtime_ns
        time.sleep(0.3)
        assert (tmp_path / "lease").stat().st_mtime_ns > before and not lost.is_set(), "and is touched again"


def test_who_saw_the_death_too_late_does_not_bury_the_new_owner(tmp_path):
    stranger(tmp_path / "lease", host="elsewhere")
    assert not lease._bury(tmp_path / "lease", "of-another, who was there before", "mine", 0.2)
    assert lease.owner(tmp_path / "lease")["token"] == "of-elsewhere"
    assert [path.name for path in tmp_path.iterdir()] == ["lease"]
    assert lease._bury(tmp_path / "lease", "of-elsewhere", "mine", 0.2)
