#!/usr/bin/env bash
# Random kills in one sweep on a private Slurm cluster: of tasks, of whole nodes, by preemption, at the time limit, by
# scancel and a new submission. The merged metrics must be, bit by bit, those of the same sweep without Slurm and kills.
#
#     tests/cluster/kills.sh [kills, 20] [seed, 0]          some 15 minutes on two cores
source "$(dirname "${BASH_SOURCE[0]}")/private_slurm.sh"
bring_up
"$python" tests/cluster/kills.py "$work" "${1:-20}" "${2:-0}"
