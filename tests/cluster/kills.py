"""The kills of `kills.sh`, on the cluster that it brought up, and the comparison with a sweep that nobody disturbed."""

import contextlib
import filecmp
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

SWEEP = [sys.executable, "-m", "srl_jax.sweep"]
LANES = ["--preset", "smoke", "--seeds", "6", "--steps", "120000", "--evaluation.episodes", "2"]
PACKS = ["--train.evaluate-every", "1600", "--train.checkpoint-every", "1600", "--pack-lanes", "2", "--cpus", "1"]
LIMIT = "60"  # min, that nobody reaches unless the test takes time away
PAUSE = (2.0, 25.0)  # s between kills
PATIENCE = 240.0  # s until a task runs again, or one that was killed has gone


def said(*command: str) -> str:
    """What a command prints."""
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


class Cluster:
    """The sweep on the cluster, and the ways in which its tasks are killed."""

    def __init__(self, work: Path, rng: random.Random):
        self.work, self.sweep, self.rng = work, work / "sweep", rng

    def jobs(self) -> dict[int, tuple[str, str]]:
        """pack -> job and node of the task that Slurm says is running."""
        lines = said("squeue", "--noheader", "--array", "--states=RUNNING", "--format=%i %N").splitlines()
        found = [line.split() for line in lines if "_" in line]
        first = self.first_packs()
        return {first[job.split("_")[0]] + int(job.split("_")[1]): (job, node) for job, node in found}

    def first_packs(self) -> dict[str, int]:
        """The number of the first pack of every array, by its job: the one argument of its script."""
        lines = said("squeue", "--noheader", "--format=%F %o").splitlines()
        return {line.split()[0]: int(line.split()[-1]) for line in lines if line.split()[-1].isdecimal()}

    def attempt(self, pack: int) -> tuple[int, int]:
        """How many attempts a pack has had, and the process of the last if it is alive, else 0."""
        path = self.sweep / "tasks" / f"{pack:05d}" / "attempts.jsonl"
        lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        begun = [line for line in lines if "host" in line]
        alive = begun and "host" in lines[-1] and Path(f"/proc/{begun[-1]['pid']}").exists()
        return len(begun), begun[-1]["pid"] if alive else 0

    def step(self, pack: int) -> int:
        """The last step that a pack has measured; -1 before the first."""
        path = self.sweep / "packs" / f"{pack:05d}" / "metrics.csv"
        rows = path.read_text().splitlines() if path.exists() else []
        return int(rows[-1].split(",")[0]) if len(rows) > 1 else -1

    def hasten(self) -> None:
        """Begins what Slurm holds back, with all of its time; not at once: a node refuses what it has just killed."""
        while True:
            time.sleep(0.5)
            lines = said("squeue", "--noheader", "--array", "--states=PENDING", "--format=%i %S %r").splitlines()
            for job, start, reason in (line.split(maxsplit=2) for line in lines):
                held = reason != "Dependency" and start != "N/A"
                if held and (datetime.fromisoformat(start) - datetime.now()).total_seconds() > 10:
                    said("scontrol", "update", f"JobId={job}", "StartTime=now+3", f"TimeLimit={LIMIT}")

    def victim(self) -> tuple[int, int, str, str]:
        """A pack whose task runs: its number, process, job and node; empty-handed (-1) when the sweep is over."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            running = [(pack, self.attempt(pack)[1], *where) for pack, where in self.jobs().items()]
            running = [found for found in running if found[1]]
            if running:
                return self.rng.choice(sorted(running))
            if not said("squeue", "--noheader"):
                break
            time.sleep(0.2)
        return -1, 0, "", ""

    # The ways.

    def task(self, process: int, job: str, node: str) -> None:
        """As when memory runs out."""
        os.kill(process, signal.SIGKILL)

    def node(self, process: int, job: str, node: str) -> None:
        """slurmd and all that it started; the node comes back before or after Slurm has missed it."""
        slurmd = int((self.work / f"slurmd.{node}.pid").read_text())
        tasks = [pid for pid in processes() if own(pid, "SLURMD_NODENAME", node)]
        stepds = {parent(pid) for pid in tasks if "slurmstepd" in name(parent(pid))}
        for pid in [slurmd, *stepds, *tasks]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(self.rng.choice((1.0, 40.0)))
        core = str((int(node[1:]) - 1) % (os.cpu_count() or 1))
        subprocess.run(["taskset", "-c", core, "slurmd", "-N", node], check=True)

    def preemption(self, process: int, job: str, node: str) -> None:
        """A job of a better partition wants the node."""
        said("sbatch", "--partition=urgent", f"--nodelist={node}", "--output=/dev/null", "--wrap", "sleep 3")

    def limit(self, process: int, job: str, node: str) -> None:
        """The time limit comes near: 120 s before it, at once here, Slurm signals the script."""
        said("scontrol", "update", f"JobId={job}", "TimeLimit=2")

    def cancel(self, process: int, job: str, node: str) -> None:
        """All of the sweep is cancelled and, when it has left, submitted again."""
        print(said(*SWEEP, "--out", str(self.sweep), "--cancel").strip())
        until = time.monotonic() + PATIENCE
        while said("squeue", "--noheader"):
            assert time.monotonic() < until, "cancelled, and still in the queue:\n" + said("squeue", "--array")
            time.sleep(0.2)
        print(said(*SWEEP, "--out", str(self.sweep), "--resume").strip().splitlines()[0])


def processes() -> list[int]:
    """All of this machine."""
    return [int(path.name) for path in Path("/proc").glob("[0-9]*")]


def own(pid: int, key: str, value: str) -> bool:
    """Whether a process belongs to this cluster and has a variable of that value."""
    try:
        environment = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return False
    return {f"SLURM_CONF={os.environ['SLURM_CONF']}".encode(), f"{key}={value}".encode()} <= set(environment)


def parent(pid: int) -> int:
    """The process that started a process."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


def name(pid: int) -> str:
    """Its command line."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def disturb(cluster: Cluster, kills: int) -> list[str]:
    """Kills so many times; returns the kinds, in order."""
    ways: dict[str, Callable[[int, str, str], None]] = {
        "kill -9 of a task": cluster.task,
        "kill -9 of a node": cluster.node,
        "preemption": cluster.preemption,
        "time limit": cluster.limit,
        "cancel and resume": cluster.cancel,
    }
    order = [kind for _ in range(-(-kills // len(ways))) for kind in ways][:kills]
    cluster.rng.shuffle(order)
    done, began = [], time.monotonic()
    for kind in order:
        time.sleep(cluster.rng.uniform(*PAUSE))
        pack, process, job, node = cluster.victim()
        if pack < 0:
            break
        attempts, step = cluster.attempt(pack)[0], cluster.step(pack)
        print(f"{time.monotonic() - began:5.0f} s  {kind}: pack {pack} at step {step}, attempt {attempts}", flush=True)
        ways[kind](process, job, node)
        until = time.monotonic() + PATIENCE
        while Path(f"/proc/{process}").exists() and time.monotonic() < until:
            time.sleep(0.1)
        if Path(f"/proc/{process}").exists():
            print(f"         it did not end within {PATIENCE:.0f} s")
        done.append(kind)
    return done


def compare(one: Path, other: Path, packs: int) -> list[str]:
    """The files in which two sweeps differ, of those that must be equal."""
    files = [f"packs/{number:05d}/metrics.csv" for number in range(packs)]
    files += ["merged/metrics.csv", "merged/lanes.csv"]
    return [file for file in files if not filecmp.cmp(one / file, other / file, shallow=False)]


def main(work: Path, kills: int, seed: int) -> int:
    """The sweep with kills, then without; 0 if they are equal and there were as many kills as asked for."""
    cluster, began = Cluster(work, random.Random(seed)), time.monotonic()
    threading.Thread(target=cluster.hasten, daemon=True).start()
    subprocess.run(
        [*SWEEP, *LANES, *PACKS, "--engine", "slurm", "--time", LIMIT, "--out", str(cluster.sweep)], check=True
    )
    done = disturb(cluster, kills)
    while said("squeue", "--noheader"):
        time.sleep(1)
    took = time.monotonic() - began
    subprocess.run([*SWEEP, "--out", str(cluster.sweep), "--status"], check=False)
    packs = len(list((cluster.sweep / "tasks").iterdir()))
    attempts = [cluster.attempt(pack)[0] for pack in range(packs)]
    print(f"{len(done)} kills: " + ", ".join(f"{done.count(kind)} {kind}" for kind in sorted(set(done))))
    print(f"attempts of each pack: {attempts}; {took:.0f} s")
    if not (cluster.sweep / "merged" / "summary.json").exists():
        print("failed: nothing was merged")
        return 1

    plain = work / "plain"
    subprocess.run([*SWEEP, *LANES, *PACKS, "--out", str(plain), "--plan-only"], check=True, stdout=subprocess.DEVNULL)
    (plain / "cache").symlink_to(cluster.sweep / "cache")
    subprocess.run([*SWEEP, "--out", str(plain), "--resume", "--jobs", str(min(2, os.cpu_count() or 1))], check=True)
    different = compare(plain, cluster.sweep, packs)
    print(f"failed: these differ: {' '.join(different)}" if different else "ok: merged and single metrics are equal")
    return int(bool(different) or len(done) < kills)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
