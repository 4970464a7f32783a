"""Slurm without Slurm: what is submitted, and what the generated script does when it is signalled or a task fails."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from srl_jax.sweep import attempts, slurm, task
from srl_jax.sweep.slurm import Options
from tests.sweep import packs

PROGRAM = """#!{python}
# Stands for the task: writes down every TERM, saves for a moment after the first, and ends as the file `code` says.
import signal, sys, time
from pathlib import Path
folder, terms = Path("{folder}"), []
def say(word):
    with (folder / "log").open("a") as file:
        file.write(word + "\\n")
signal.signal(signal.SIGTERM, lambda *_: (say("TERM"), terms.append(1)))
say(" ".join(["began", *sys.argv[1:]]))
until = time.monotonic() + float((folder / "lasts").read_text())
while time.monotonic() < until and not terms:
    time.sleep(0.01)
if terms:
    time.sleep(0.5)
    sys.exit(143)
sys.exit(int((folder / "code").read_text()))
"""
FAKE = """#!/bin/bash
echo "$(basename "$0") $@" >> "{folder}/calls"
case "$(basename "$0")" in
    sbatch) n=$(( $(cat "{folder}/jobs" 2>/dev/null || echo 100) + 1 )); echo $n > "{folder}/jobs"; echo "$n;here" ;;
    sinfo) if [ "$2" = --Node ]; then cat "{folder}/hosts"; else printf 'cpu*\nurgent\n'; fi ;;
    squeue) cat "{folder}/queued" 2>/dev/null ;;
    scontrol) case "$2" in
        config) echo "MaxArraySize            = 3" ;;
        job) cat "{folder}/job" 2>/dev/null || echo "   PreemptTime=None ExcNodeList=(null)" ;;
    esac ;;
esac
exit 0
"""


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Commands of Slurm that write down how they were called."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("sbatch", "scontrol", "sinfo", "scancel", "squeue"):
        (folder / name).write_text(FAKE.format(folder=tmp_path))
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    return lambda: (tmp_path / "calls").read_text().splitlines() if (tmp_path / "calls").exists() else []


@pytest.fixture
def script(tmp_path, cluster, monkeypatch):
    """(code, seconds) -> the generated script as a process, its task being a program that ends so after so long."""
    program, log = tmp_path / "program", tmp_path / "log"
    program.write_text(PROGRAM.format(folder=tmp_path, python=sys.executable))
    program.chmod(0o755)
    monkeypatch.setattr(task, "PROGRAM", (str(program), "-m", "srl_jax.sweep"))
    sweep = packs.planned(tmp_path / "s")
    (tmp_path / "s" / "slurm").mkdir()

    def start(code, seconds, restarts=0):
        (tmp_path / "code").write_text(str(code))
        (tmp_path / "lasts").write_text(str(seconds))
        (tmp_path / "pack.sh").write_text(slurm.array_script(sweep, Options(cpus=1, time="1:00:00", retries=3)))
        job = {"SLURM_ARRAY_JOB_ID": "7", "SLURM_ARRAY_TASK_ID": "2", "SLURM_RESTART_COUNT": str(restarts)}
        job["SLURMD_NODENAME"] = "n4"
        process = subprocess.Popen(
            ["bash", str(tmp_path / "pack.sh"), "1000"], env=os.environ | job, start_new_session=True
        )
        while not log.exists():
            time.sleep(0.02)
        return process

    return start, lambda: log.read_text().splitlines()


def test_a_task_works_on_the_pack_of_its_number(script, tmp_path):
    start, log = script
    assert start(0, 0).wait() == 0
    assert log() == [f"began -m srl_jax.sweep --out {tmp_path}/s --run-pack 1002"]


@pytest.mark.parametrize(
    ("code", "restarts", "requeued"), [(0, 0, False), (2, 0, False), (1, 0, True), (75, 0, True), (1, 3, False)]
)
def test_what_failed_is_requeued_unless_it_would_fail_again(code, restarts, requeued, script, cluster):
    start, _ = script
    assert start(code, 0, restarts).wait() == code
    assert ("scontrol requeue 7_2" in cluster()) == requeued


def test_near_the_time_limit_the_program_gets_one_term(script, cluster):
    start, log = script
    process = start(0, 30)
    process.send_signal(signal.SIGUSR1)
    assert process.wait(timeout=20) == 143
    assert log().count("TERM") == 1 and "scontrol requeue 7_2" in cluster()


def test_a_pack_may_reach_the_time_limit_more_often_than_it_may_fail(script, cluster, tmp_path):
    start, _ = script
    for restarts in range(5):
        process = start(0, 30, restarts)
        process.send_signal(signal.SIGUSR1)
        assert process.wait(timeout=20) == 143
        (tmp_path / "log").unlink()
    assert cluster().count("scontrol requeue 7_2") == 5, "although three retries are allowed"
    for restarts in range(5, 9):
        assert start(1, 0, restarts).wait() == 1
        (tmp_path / "log").unlink()
    assert cluster().count("scontrol requeue 7_2") == 8, "failures are still counted"


@pytest.mark.parametrize(
    ("about", "requeued"), [("PreemptTime=None", False), ("PreemptTime=2026-11-28T13:00:00", True)]
)
def test_a_term_that_slurm_sends_to_both_is_not_passed_on(about, requeued, script, cluster, tmp_path):
    (tmp_path / "job").write_text(f"   PreemptEligibleTime=2026-11-28T12:00:00 {about}\n")
    start, log = script
    process = start(0, 30)
    os.killpg(process.pid, signal.SIGTERM)
    assert process.wait(timeout=20) == 143
    assert log().count("TERM") == 1
    assert ("scontrol requeue 7_2" in cluster()) == requeued, (
        "what is cancelled does not come back, what is preempted does"
    )


@pytest.mark.parametrize(("before", "after"), [("(null)", "n4"), ("n[1-2]", "n[1-2],n4")])
def test_a_node_without_python_is_left_out(before, after, script, cluster, tmp_path):
    (tmp_path / "job").write_text(f"   ReqNodeList=(null) ExcNodeList={before}\n")
    start, _ = script
    assert start(127, 0).wait() == 127
    assert cluster()[-1] == f"scontrol update JobId=7_2 ExcNodeList={after}"
    lines = attempts.read(tmp_path / "s" / "tasks" / "01002")
    assert [line.get("host") for line in lines] == ["n4", None] and lines[1]["error"] == "there is no Python"
    assert start(1, 0).wait() == 1
    assert cluster()[-1] == "scontrol requeue 7_2"


@pytest.mark.parametrize(("code", "calls"), [(0, 0), (1, 0), (127, 2)])
def test_a_merge_on_a_node_without_python_moves_to_another(code, calls, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(task, "PROGRAM", ("sh", "-c", f"exit {code}"))
    (tmp_path / "merge.sh").write_text(slurm.merge_script(packs.planned(tmp_path / "s"), Options(1, "1:00:00")))
    job = {"SLURM_JOB_ID": "9", "SLURMD_NODENAME": "n4"}
    assert subprocess.run(["bash", str(tmp_path / "merge.sh")], env=os.environ | job, check=False).returncode == code
    assert cluster() == ["scontrol requeue 9", "scontrol update JobId=9 ExcNodeList=n4"][:calls]


def test_packs_are_submitted_as_arrays_with_a_merge_after_all(tmp_path, cluster):
    sweep = packs.planned(tmp_path / "s", 2)
    options = Options(cpus=4, time="2:00:00", partition="cpu", at_once=2, memory_mb=900, extra=("--account=x",))
    assert len(sweep) == 6
    assert slurm.submit(sweep, [0, 1, 3, 4, 5], options) == ["101", "102", "103", "104"]
    folder = tmp_path / "s" / "slurm"
    submitted = [line for line in cluster() if line.startswith("sbatch")]
    assert submitted == [
        f"sbatch --parsable --array=0-1%2 {folder}/pack.sh 0",
        f"sbatch --parsable --array=0-1%2 {folder}/pack.sh 3",
        f"sbatch --parsable --array=0%2 {folder}/pack.sh 5",
        f"sbatch --parsable --dependency=afterany:101:102:103 {folder}/merge.sh",
    ]
    text = (folder / "pack.sh").read_text()
    wanted = ("cpus-per-task=4", "time=2:00:00", "partition=cpu", "mem=900M", "signal=B:USR1@120", "requeue")
    for option in (*wanted, "account=x"):
        assert f"#SBATCH --{option}\n" in text
    (tmp_path / "queued").write_text("99\n102\n102\n104\n")
    with pytest.raises(ValueError, match=r"has jobs in the queue \(102 104\): wait for them, or --cancel"):
        slurm.submit(sweep, [0], options)
    assert slurm.cancel(sweep) == ["102", "104"]
    assert cluster()[-1] == "scancel --quiet 102 104"
    (tmp_path / "queued").unlink()
    assert slurm.cancel(sweep) == [] and slurm.submit(sweep, [0], options) == ["105", "106"]


@pytest.mark.parametrize(
    ("numbers", "most", "expected"),
    [
        ([0, 1, 2], 1000, [(0, "0-2")]),
        ([0, 2, 3, 7], 1000, [(0, "0,2-3,7")]),
        ([5, 6, 1500], 1000, [(5, "0-1"), (1500, "0")]),
        ([], 10, []),
    ],
)
def test_arrays(numbers, most, expected):
    assert slurm.arrays(numbers, most) == expected


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90", 5_400), ("2:30", 150), ("1:02:03", 3_723), ("1-0", 86_400), ("1-2:30", 95_400), ("0-0:0:5", 5)],
)
def test_times_of_slurm(text, seconds):
    assert slurm.seconds(text) == seconds


@pytest.mark.parametrize("text", ["", "soon", "1:2:3:4", "-5", "1.5"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"time is .*: give minutes"):
        slurm.seconds(text)


def test_what_a_cluster_does_not_have(cluster, monkeypatch):
    slurm.check(Options(1, "1:00:00", "urgent"))
    with pytest.raises(ValueError, match="partition is 'gpu': this cluster has cpu, urgent"):
        slurm.check(Options(1, "1:00:00", "gpu"))
    with pytest.raises(ValueError, match="time is 2: a task is asked to save 120 s before it ends"):
        slurm.check(Options(1, "2"))
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ValueError, match="engine is slurm: no sbatch is on the PATH"):
        slurm.check(Options(1, "1:00:00"))


def test_a_directory_that_other_machines_do_not_see(cluster, tmp_path):
    own = socket.gethostname()
    (tmp_path / "hosts").write_text(f"{own}\n{own}\n")
    slurm.check_shared(Path("/tmp/sweep"))
    (tmp_path / "hosts").write_text(f"{own}.lab.example\nnode7\n")
    slurm.check_shared(Path("/home/you/sweep"))
    with pytest.raises(ValueError, match=r"out is /tmp/sweep: /tmp/ is this machine's own, and node7 would not see it"):
        slurm.check_shared(Path("/tmp/sweep"))
