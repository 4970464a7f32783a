"""The engine of one machine: who works on what, on which cores, how often, and how it stops."""

import os
import sys
import threading
import time

import pytest

from srl_jax import machine
from srl_jax.sweep import local, task
from srl_jax.sweep.task import Order
from tests.sweep import packs

TASK = """
import json, os, signal, sys, time
from pathlib import Path
directory, number = Path(sys.argv[1]), int(sys.argv[2])
plans = json.loads((directory / "plans.json").read_text())
log = directory / "log.jsonl"
begun = log.read_text().count(f'"{number}"') if log.exists() else 0
def say(**facts):
    with log.open("a") as file:
        file.write(json.dumps({"pack": str(number), "at": time.monotonic(), **facts}) + "\\n")
say(cores=sorted(os.sched_getaffinity(0)))
signal.signal(signal.SIGTERM, lambda *_: (say(saved=True), sys.exit(143)))
code, seconds = (plans.get(str(number)) or [[0, 0.05]])[min(begun // 2, len(plans.get(str(number), [0])) - 1)]
time.sleep(seconds)
say(code=code)
if code == 0:
    pack = directory / "packs" / f"{number:05d}"
    pack.mkdir(parents=True, exist_ok=True)
    (pack / "summary.json").touch()
if code == -9:
    os.kill(os.getpid(), signal.SIGKILL)
sys.exit(code)
"""


@pytest.fixture
def engine(tmp_path, monkeypatch):
    """(plans, options) -> what is left, the log; packs do as they are told: exit code and seconds of each attempt."""
    script = tmp_path / "task.py"
    script.write_text(TASK)
    monkeypatch.setattr(
        task, "command", lambda directory, number: [sys.executable, str(script), str(directory), str(number)]
    )
    monkeypatch.setattr(local, "POLL", 0.01)
    sweep = packs.planned(tmp_path / "s", 3)  # four packs

    def run(plans, *, cpus=1, jobs=1, retries=2, **options):
        import json

        (tmp_path / "s" / "plans.json").write_text(json.dumps(plans))
        local.run(Order(sweep, cpus, jobs, retries, **options))
        log = tmp_path / "s" / "log.jsonl"
        return sweep.unfinished(), [json.loads(line) for line in log.read_text().splitlines()]

    return run


def test_every_pack_is_done_once(engine):
    told = []
    left, log = engine({}, told=lambda number, code: told.append((number, code)))
    assert left == [] and told == [(number, 0) for number in range(4)]
    assert [line["pack"] for line in log if "code" in line] == ["0", "1", "2", "3"]
    assert engine({})[0] == [] and len(engine({})[1]) == 8, "what is done is not begun again"


def test_what_fails_or_is_killed_is_tried_again_and_the_others_go_on(engine):
    left, log = engine({"0": [[1, 0], [-9, 0], [0, 0]], "2": [[1, 0]]}, retries=2)
    assert left == [2]
    codes = [(line["pack"], line["code"]) for line in log if "code" in line]
    assert codes.count(("2", 1)) == 3 and [code for pack, code in codes if pack == "0"] == [1, -9, 0]
    assert {("1", 0), ("3", 0)} <= set(codes)


def test_a_disk_too_full_for_a_log_stops_only_that_pack(engine, monkeypatch):
    start, told = local._start, []

    def full(sweep, number, cores):
        if number == 1:
            raise OSError(28, "No space left on device", "log")
        return start(sweep, number, cores)

    monkeypatch.setattr(local, "_start", full)
    left, _ = engine({}, retries=2, told=lambda number, code: told.append((number, code)))
    assert left == [1] and told.count((1, task.FAILED)) == 3


@pytest.mark.parametrize("code", [task.USAGE, task.IN_USE])
def test_what_would_fail_again_is_not_tried_again(code, engine):
    left, log = engine({"1": [[code, 0]]}, retries=5)
    assert left == [1] and [line["pack"] for line in log if line.get("code") == code] == ["1"]


@pytest.mark.skipif(machine.cores() < 2, reason="needs two cores")
def test_packs_side_by_side_keep_to_their_own_cores(engine):
    _, log = engine({str(number): [[0, 0.3]] for number in range(4)}, jobs=2)
    cores = {tuple(line["cores"]) for line in log if "cores" in line}
    assert len(cores) == 2 and all(len(own) == 1 for own in cores)
    begun = {line["pack"]: line["at"] for line in log if "cores" in line}
    ended = {line["pack"]: line["at"] for line in log if "code" in line}
    assert begun["1"] < ended["0"], "two at once"
    assert begun["2"] > min(ended["0"], ended["1"]), "and not three"


def test_a_stop_saves_what_runs_and_begins_nothing(engine):
    stop = threading.Event()
    threading.Timer(0.8, stop.set).start()
    began = time.monotonic()
    left, log = engine({"0": [[0, 60]]}, stopped=stop.is_set)
    assert time.monotonic() - began < 30 and left == [0, 1, 2, 3]
    assert [line["pack"] for line in log if line.get("saved")] == ["0"] and len(log) == 2


def test_more_cores_than_there_are():
    with pytest.raises(ValueError, match=r"cpus is 64 and jobs 2: together they want 128 cores, this machine has \d+"):
        local.core_sets(64, 2)
    sets = local.core_sets(1, machine.cores())
    assert None not in sets and set().union(*(own or set() for own in sets)) == os.sched_getaffinity(0)
