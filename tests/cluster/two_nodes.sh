#!/usr/bin/env bash
# How much faster two nodes of one core each are than one: the same sweep of equal packs first on one node, then on two,
# on a private Slurm cluster; prints lanes a second, apart from compiling, and their ratio. The machine has to be idle.
#
#     tests/cluster/two_nodes.sh [half of the packs, 3] [steps, 200000]
source "$(dirname "${BASH_SOURCE[0]}")/private_slurm.sh"
[ "$(nproc)" -ge 2 ] || { echo "skipped: this needs two cores"; exit 0; }
bring_up

packs=$((2 * ${1:-3}))
options=(--preset smoke --seeds "$packs" --steps "${2:-200000}" --train.evaluate-every 20000 --train.checkpoint-every 20000
    --evaluation.episodes 2 --pack-lanes 2 --cpus 1 --engine slurm --time 60)

# Compile once, for both.
sweep "${options[@]}" --partition one --out "$work/warm" --plan-only
sweep --out "$work/warm" --run-pack 0 > /dev/null

# From the first task's begin to the last one's end, in seconds; and by what packs say of their training, without starts.
for partition in one cpu; do
    sweep "${options[@]}" --partition "$partition" --out "$work/$partition" --plan-only > /dev/null
    ln -s "$work/warm/cache" "$work/$partition/cache"
    sweep --out "$work/$partition" --resume
    finished
done
"$python" - "$work" "$packs" <<'PY'
import json, pathlib, sys
from datetime import datetime

rates, training = {}, {}
for partition, nodes in (("one", 1), ("cpu", 2)):
    paths = list(pathlib.Path(sys.argv[1], partition, "tasks").glob("*/attempts.jsonl"))
    times = [datetime.fromisoformat(json.loads(line)["at"]) for path in paths for line in path.read_text().splitlines()]
    assert len(times) == 2 * int(sys.argv[2]), "every pack is begun and ended once"
    found = pathlib.Path(sys.argv[1], partition, "packs").glob("*/summary.json")
    each = [json.loads(path.read_text())["machine"]["environment_steps_per_second"] for path in found]
    training[nodes] = sum(each) / len(each)
    took = (max(times) - min(times)).total_seconds()
    rates[nodes] = 2 * int(sys.argv[2]) / took
    print(f"{nodes} node{'s' if nodes > 1 else ''}: {took:.0f} s, {rates[nodes]:.4f} lanes/s")
print(f"two nodes against twice one: {rates[2] / rates[1] / 2:.1%}")
print(f"of that training alone: {training[1]:.0f} environment steps/s by itself, {training[2]:.0f} beside the other node's")
print(f"  {training[2] / training[1]:.1%}; the rest is how tasks start, and the wait for the scheduler")
PY
