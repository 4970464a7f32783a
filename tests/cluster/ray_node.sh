#!/usr/bin/env bash
# One sweep on a private Ray cluster of two nodes on this machine, one of which is killed while it works on a pack: the
# metrics must be, bit by bit, those of the same packs without Ray. Skipped where Ray is missing.
#
#     tests/cluster/ray_node.sh          PYTHON=... for another than that of .venv
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

python=${PYTHON:-$PWD/.venv/bin/python}
if ! "$python" -c 'import ray' 2>/dev/null; then
    echo "skipped: $python has no Ray (pip install -c constraints.txt -e '.[ray]')"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$python" tests/cluster/ray_node.py "$work"
