"""A Ray cluster of a head and two nodes of one core, and the kill of the node that works on a pack (`ray_node.sh`)."""

import contextlib
import filecmp
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from ray.cluster_utils import Cluster

SWEEP = [sys.executable, "-m", "srl_jax.sweep"]
LANES = ["--preset", "smoke", "--algos", "ddpg", "--seeds", "8", "--steps", "12000", "--evaluation.episodes", "2"]
PACKS = ["--train.evaluate-every", "800", "--train.checkpoint-every", "800", "--pack-lanes", "2", "--cpus", "1"]
STORE = 100 * 2**20  # bytes; packs leave nothing in it
PATIENCE = 300.0  # s


def parents(pid: int) -> list[int]:
    """The processes from which a process descends."""
    found = []
    while pid > 1:
        pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        found.append(pid)
    return found


def descendants(pid: int) -> list[int]:
    """The processes that descend from a process, and itself."""
    everyone = [int(path.name) for path in Path("/proc").glob("[0-9]*")]
    found = []
    for other in everyone:
        with contextlib.suppress(OSError):
            if other == pid or pid in parents(other):
                found.append(other)
    return found


def trained(sweep: Path) -> tuple[int, int]:
    """A pack with a checkpoint, and the process that is working on it."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        for path in sorted(sweep.glob("packs/*/checkpoints/[0-9]*")):
            pack = path.parts[-3]
            last = json.loads((sweep / "tasks" / pack / "attempts.jsonl").read_text().splitlines()[-1])
            if "pid" in last and Path(f"/proc/{last['pid']}").exists():
                return int(pack), last["pid"]
        time.sleep(0.05)
    raise TimeoutError("no task has written a checkpoint")


def disturbed(sweep: Path) -> None:
    """The sweep, one of whose two nodes is killed."""
    cluster = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False, "object_store_memory": STORE}
    )
    nodes = [cluster.add_node(num_cpus=1, object_store_memory=STORE) for _ in range(2)]
    cluster.wait_for_nodes()
    words = [*SWEEP, *LANES, *PACKS, "--engine", "ray", "--ray-address", cluster.address, "--out", str(sweep)]
    try:
        driver = subprocess.Popen(words, stderr=subprocess.DEVNULL)  # Ray says at length that a node is lost
        pack, process = trained(sweep)
        raylets = {node.all_processes["raylet"][0].process.pid for node in nodes}
        raylet = (raylets & set(parents(process))).pop()
        for pid in descendants(raylet):  # a lost node takes all of them with it
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        print(f"killed the node of pack {pack}", flush=True)
        assert driver.wait(timeout=2 * PATIENCE) == 0, "the sweep did not finish"
    finally:
        cluster.shutdown()
    attempts = {path.parts[-2]: path.read_text().count('"host"') for path in sweep.glob("tasks/*/attempts.jsonl")}
    print(f"attempts: {attempts}")
    assert attempts[f"{pack:05d}"] >= 2, "the pack whose node was killed was not begun again"


def main(work: Path) -> None:
    """With the kill and without."""
    began = time.monotonic()
    disturbed(work / "sweep")
    print(f"with a node killed: {time.monotonic() - began:.0f} s")
    plain = work / "plain"
    subprocess.run([*SWEEP, *LANES, *PACKS, "--out", str(plain), "--plan-only"], check=True, stdout=subprocess.DEVNULL)
    (plain / "cache").symlink_to(work / "sweep" / "cache")
    subprocess.run([*SWEEP, "--out", str(plain), "--resume", "--jobs", "2"], check=True)
    files = [*(f"packs/{number:05d}/metrics.csv" for number in range(4)), "merged/metrics.csv", "merged/lanes.csv"]
    different = [file for file in files if not filecmp.cmp(plain / file, work / "sweep" / file, shallow=False)]
    assert not different, f"these differ: {different}"
    print("ok: every metric is equal, bit by bit, to that of the same packs without Ray")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
