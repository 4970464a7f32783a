#!/usr/bin/env bash
# One sweep on a private Slurm cluster of two nodes, its first task killed on the way, and the same packs without Slurm:
# every number must be equal.
#
#     tests/cluster/slurm.sh          PYTHON=... for another than that of .venv
source "$(dirname "${BASH_SOURCE[0]}")/private_slurm.sh"
bring_up
export XLA_FLAGS=--xla_backend_optimization_level=0  # compiling is most of what this takes; tasks inherit it

# One algorithm and four seeds compile fastest; 20 checkpoints leave time to kill between two of them.
options=(--preset smoke --algos ddpg --seeds 4 --steps 3200 --train.evaluate-every 160 --train.checkpoint-every 160
    --evaluation.episodes 2 --pack-lanes 2 --cpus 1)
sweep "${options[@]}" --time 10 --partition cpu --engine slurm --out "$work/sweep"

# Kill the first task that has a checkpoint, as if its node had run out of memory.
"$python" - "$work/sweep" <<'PY'
import glob, json, os, pathlib, signal, sys, time
until = time.monotonic() + 300
while not (found := glob.glob(f"{sys.argv[1]}/packs/*/checkpoints/[0-9]*")):
    assert time.monotonic() < until, "no task has written a checkpoint"
    time.sleep(0.02)
pack = pathlib.Path(found[0]).parts[-3]
lines = pathlib.Path(sys.argv[1], "tasks", pack, "attempts.jsonl").read_text().splitlines()
os.kill(json.loads(lines[-1])["pid"], signal.SIGKILL)
print(f"killed pack {pack}", flush=True)
PY
finished
sweep --out "$work/sweep" --status
cat "$work"/sweep/slurm/merge-*.out
[ "$(cat "$work"/sweep/tasks/*/attempts.jsonl | grep -c '"host"')" = 3 ] || { echo "the killed pack was not begun again"; exit 1; }

# The same packs without Slurm and without a kill, with the programs that are compiled already.
mv "$work/sweep/cache" "$work/cache"
sweep "${options[@]}" --out "$work/plain" --plan-only
ln -s "$work/cache" "$work/plain/cache"
sweep --out "$work/plain" --resume --jobs "$(nproc)" > "$work/plain.txt" || { cat "$work/plain.txt"; exit 1; }
for file in packs/00000/metrics.csv packs/00001/metrics.csv merged/metrics.csv merged/lanes.csv; do
    cmp "$work/plain/$file" "$work/sweep/$file"
done
echo "ok: every metric is equal, bit by bit, to that of the same packs without Slurm"
