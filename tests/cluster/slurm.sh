#!/usr/bin/env bash
# A private Slurm cluster of two nodes on this machine, one sweep on it whose first task is killed, and the same packs
# locally: every number must be equal. Installs nothing; without slurmctld it says so and is skipped.
#
#     tests/cluster/slurm.sh [python]
set -euo pipefail

python=${1:-.venv/bin/python}
for tool in slurmctld slurmd sbatch munged; do
    if ! PATH=$PATH:/usr/sbin command -v "$tool" >/dev/null; then
        echo "skipped: there is no $tool (Debian: apt-get install slurmctld slurmd slurm-client munge)"
        exit 0
    fi
done
if [ "$(id -u)" != 0 ]; then
    echo "skipped: slurmd has to be started by root"
    exit 0
fi
export PATH=$PATH:/usr/sbin

work=$(mktemp -d)
conf=$work/slurm.conf
host=$(hostname -s)
stop() {
    code=$?
    trap - EXIT
    [ "$code" = 0 ] || tail -n 30 "$work"/*.log "$work"/sweep/slurm/*.out "$work"/sweep/tasks/*/attempts.jsonl 2>/dev/null || true
    scancel --quiet --user=root 2>/dev/null || true
    for pid in "$work"/*.pid "$work"/munge/pid; do [ -f "$pid" ] && kill -9 "$(cat "$pid")" 2>/dev/null || true; done
    rm -rf "$work"
    exit "$code"
}
trap stop EXIT

chmod 711 "$work"
mkdir -m 711 "$work/munge"
mkdir "$work/state" "$work/spool.n1" "$work/spool.n2"
head -c 128 /dev/urandom > "$work/munge/key"
chmod 400 "$work/munge/key"
cat > "$conf" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool.%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
SlurmdTimeout=15
KillWait=5
ReturnToService=2
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[17001-17002] CPUs=1 RealMemory=8000
PartitionName=cpu Nodes=ALL Default=YES State=UP
CONF
export SLURM_CONF=$conf
munged --key-file="$work/munge/key" --socket="$work/munge/socket" --pid-file="$work/munge/pid" \
    --log-file="$work/munge.log" --seed-file="$work/munge/seed" --force
slurmctld
slurmd -N n1
slurmd -N n2
for _ in $(seq 60); do
    [ "$(sinfo --noheader --format=%T | sort -u)" = idle ] && break
    sleep 0.5
done
sinfo

sweep=$work/sweep
options=(--preset smoke --seeds 2 --steps 800 --train.evaluate-every 160 --train.checkpoint-every 160 --evaluation.episodes 2)
"$python" -m srl_jax.sweep "${options[@]}" --pack-lanes 2 --cpus 1 --time 10 --partition cpu --engine slurm --out "$sweep"

# Kill the first task that has a checkpoint, as if its node had run out of memory.
for _ in $(seq 600); do
    first=$(ls -d "$sweep"/packs/*/checkpoints/[0-9]* 2>/dev/null | head -n 1 || true)
    [ -n "$first" ] && break
    sleep 0.1
done
pack=$(basename "$(dirname "$(dirname "$first")")")
pkill -9 -f -- "--run-pack $((10#$pack))\$" && echo "killed pack $pack"

# A requeued job is held for two minutes; here it begins at once.
for _ in $(seq 900); do
    for job in $(squeue --noheader --array --format=%i --states=PENDING); do
        scontrol update "JobId=$job" StartTime=now 2>/dev/null || true
    done
    [ -f "$sweep/merged/summary.json" ] && grep -q '"complete": true' "$sweep/merged/summary.json" && break
    [ -z "$(squeue --noheader)" ] && break
    sleep 0.2
done
"$python" -m srl_jax.sweep --out "$sweep" --status
grep -q '"complete": true' "$sweep/merged/summary.json"
[ "$(grep -c '"host"' "$sweep/tasks/$pack/attempts.jsonl")" -ge 2 ] || { echo "the killed pack was not begun again"; exit 1; }

for pack in 0 1; do
    NPROC=1 "$python" -m srl_jax.run "${options[@]}" --part $((pack + 1))/2 --devices 1 --out "$work/local-$pack" > /dev/null
    cmp "$work/local-$pack/metrics.csv" "$sweep/packs/0000$pack/metrics.csv"
done
echo "ok: every metric is equal, bit by bit, to that of the same packs without Slurm"
