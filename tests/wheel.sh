#!/usr/bin/env bash
# Installs a wheel into an empty environment and works with it as a stranger would, outside of the checkout:
#     tests/wheel.sh dist/srl_jax-0.1.0-py3-none-any.whl
set -euo pipefail
wheel=$(realpath "$1")
constraints=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../constraints.txt")
python=$(realpath -s "${PYTHON:-python3}")
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cd "$place"
unset PYTHONPATH

"$python" -m venv empty
empty/bin/python -m pip install --quiet --disable-pip-version-check --constraint "$constraints" "$wheel"
export PATH="$place/empty/bin:$PATH"
python -c 'import pathlib, srl_jax, sys; sys.exit(not pathlib.Path(srl_jax.__file__).is_relative_to(sys.prefix))'
srl-jax --help >/dev/null
srl-jax run --preset smoke --seeds 1 --steps 800 --out runs/smoke >run.log 2>&1 || { tail -n 20 run.log; exit 1; }
for file in summary.json metrics.csv curves.png report.html; do test -s "runs/smoke/$file"; done
srl-jax export runs/smoke --out mine.npz >/dev/null
srl-jax demo runs/smoke --out demo.html >/dev/null
test -s demo.html
python -c 'from srl_jax import portable, pretrained; portable.load("mine.npz"); pretrained.load("atlas", task="x", damage="leg_rm")'
echo "$(basename "$wheel"): installed into an empty environment, trained, exported and shown outside of the checkout."
