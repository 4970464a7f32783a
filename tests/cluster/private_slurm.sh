# A private Slurm cluster of nodes n1 and n2 on this machine, one core each; sourced by the scripts beside it.
# Installs nothing; where there is no Slurm the script that sources this says so and ends, skipped.
# Afterwards: $python, $work (a new directory, removed at the end with all that was started), and the functions below.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

python=${PYTHON:-$PWD/.venv/bin/python}
export PATH=$PATH:/usr/sbin
for tool in slurmctld slurmd sbatch munged; do
    if ! command -v "$tool" >/dev/null; then
        echo "skipped: there is no $tool (Debian: apt-get install slurmctld slurmd slurm-client munge)"
        exit 0
    fi
done
if [ "$(id -u)" != 0 ]; then
    echo "skipped: slurmd has to be started by root"
    exit 0
fi

work=$(mktemp -d)
export SLURM_CONF=$work/slurm.conf

stop() {
    code=$?
    trap - EXIT
    [ "$code" = 0 ] || tail -n 30 "$work"/*.log "$work"/*/slurm/*.out "$work"/*/tasks/*/{log,attempts.jsonl} 2>/dev/null || true
    for pid in "$work"/*.pid "$work"/munge/pid; do [ -f "$pid" ] && kill -9 "$(cat "$pid")" 2>/dev/null || true; done
    # Then what they started: slurmstepd and its tasks have this cluster's configuration in their environment.
    for about in /proc/[0-9]*/environ; do
        grep -qz "^SLURM_CONF=$SLURM_CONF\$" "$about" 2>/dev/null && kill -9 "$(basename "$(dirname "$about")")" 2>/dev/null || true
    done
    umount "$work"/*/packs/* "$work/disk" 2>/dev/null || true  # of tests of full disks
    rm -rf "$work"
    exit "$code"
}
trap stop EXIT

# A node is one core: what its slurmd starts keeps to it.
start_node() { taskset -c $(((${1#n} - 1) % $(nproc))) slurmd -N "$1"; }

bring_up() {
    local host
    host=$(hostname -s)
    chmod 711 "$work"
    mkdir -m 711 "$work/munge"
    mkdir "$work/state" "$work/spool.n1" "$work/spool.n2"
    head -c 128 /dev/urandom > "$work/munge/key"
    chmod 400 "$work/munge/key"
    cat > "$SLURM_CONF" <<CONF
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
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
SlurmctldParameters=preempt_send_user_signal
SchedulerParameters=sched_interval=2
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[17001-17002] CPUs=1 RealMemory=8000
PartitionName=cpu Nodes=ALL Default=YES State=UP PriorityTier=1 GraceTime=10
PartitionName=urgent Nodes=ALL State=UP PriorityTier=10 PreemptMode=OFF
PartitionName=one Nodes=n1 State=UP PriorityTier=1
CONF
    munged --key-file="$work/munge/key" --socket="$work/munge/socket" --pid-file="$work/munge/pid" \
        --log-file="$work/munge.log" --seed-file="$work/munge/seed" --force
    slurmctld
    start_node n1
    start_node n2
    for _ in $(seq 60); do
        [ "$(sinfo --noheader --format=%T | sort -u)" = idle ] && break
        sleep 0.5
    done
    sinfo --Node
}

# Slurm holds a requeued job for two minutes; here it begins after some seconds. At once would be too early: the node
# refuses what it has only just killed, and the job is lost.
hasten() {
    local job reason start
    squeue --noheader --array --states=PENDING --format='%i %S %r' | while read -r job start reason; do
        if [ "$reason" != Dependency ] && [ "$start" != N/A ] && [ "$(date -d "$start" +%s)" -gt $(($(date +%s) + 10)) ]; then
            scontrol update "JobId=$job" StartTime=now+3 2>/dev/null || true
        fi
    done
}

# Waits until nothing of Slurm's is left to do.
finished() {
    while [ -n "$(squeue --noheader)" ]; do
        hasten
        sleep 0.3
    done
}

sweep() { "$python" -m srl_jax.sweep "$@"; }
