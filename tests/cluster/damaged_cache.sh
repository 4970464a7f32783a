#!/usr/bin/env bash
# Compiled programs that are damaged between two packs of a sweep: the second pack must say so, compile, write them anew,
# and measure what it measures with a whole cache. Needs neither Slurm nor Ray.
#
#     tests/cluster/damaged_cache.sh          PYTHON=... for another than that of .venv
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

python=${PYTHON:-$PWD/.venv/bin/python}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
sweep() { "$python" -m srl_jax.sweep "$@"; }

options=(--preset smoke --algos ddpg --seeds 4 --steps 800 --evaluation.episodes 2 --pack-lanes 2 --cpus 1)
sweep "${options[@]}" --out "$work/sweep" --plan-only
sweep --out "$work/sweep" --run-pack 0 > /dev/null
"$python" - "$work"/sweep/cache/*/ <<'PY'
import pathlib, sys
entries = sorted(pathlib.Path(sys.argv[1]).glob("*-cache"))
for number, path in enumerate(entries):  # cut short, emptied, overwritten: as killed writers and bad disks leave them
    data = path.read_bytes()
    path.write_bytes((data[: len(data) // 2], b"", b"\0" * len(data))[number % 3])
print(f"damaged {len(entries)} entries")
PY
sweep --out "$work/sweep" --run-pack 1 > /dev/null 2> "$work/said"
cut -c1-200 "$work/said"
grep -q 'removed damaged compiled programs: jit' "$work/said"

mv "$work/sweep/packs/00001" "$work/first"
sweep --out "$work/sweep" --run-pack 1 > /dev/null 2> "$work/said"
if grep 'damaged' "$work/said"; then
    echo "failed: the entries were not written anew"
    exit 1
fi
cmp "$work/first/metrics.csv" "$work/sweep/packs/00001/metrics.csv"
echo "ok: damaged programs were compiled and written anew"
