"""The scripts that are submitted to Slurm: of a task of the array, and of the merge after it."""

PACK = """\
#!/bin/bash
# One task works on one pack: finished packs are left at once, begun ones go on from their checkpoint.
{options}
#SBATCH --signal=B:USR1@{warning}
#SBATCH --requeue
#SBATCH --open-mode=append

pack=$(( ${{1:-0}} + SLURM_ARRAY_TASK_ID ))
task=${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}

# Near the time limit, or before it preempts, Slurm warns this shell alone (B:USR1): the program then gets its one TERM,
# saves and ends. Otherwise Slurm's TERM reaches the program itself; a second one, passed on, would kill it.
child= warned= told=
trap 'warned=yes; [ -n "$child" ] && kill -TERM "$child"' USR1
trap told=yes TERM

{command} --out {directory} --run-pack "$pack" &
child=$!
while :; do
    wait "$child"
    code=$?
    kill -0 "$child" 2>/dev/null || break
done

nothing=
saved={directory}/slurm/$task.saved  # a line for every time that it was stopped in good order: no failure
case $code in
    0) exit 0 ;;
    2) exit 2 ;;  # bad input would fail again
    143) date >> "$saved" ;;
    126 | 127)  # there is no Python: nobody else has recorded the attempt
        nothing=yes
        attempts={directory}/tasks/$(printf %05d "$pack")/attempts.jsonl now=$(date -Iseconds)
        mkdir -p "$(dirname "$attempts")"
        printf '{{"at": "%s", "host": "%s", "job": "%s"}}\\n' "$now" "$SLURMD_NODENAME" "$task" >> "$attempts"
        printf '{{"at": "%s", "exit": %s, "error": "there is no Python"}}\\n' "$now" "$code" >> "$attempts"
        ;;
esac
# Whoever cancels a task does not want it requeued, whoever preempts it does.
if [ -n "$told" ] && [ -z "$warned" ] && scontrol show job "$task" | grep -q PreemptTime=None; then
    exit "$code"
fi
# Slurm itself requeues what it preempts and what dies with its node, but neither kills nor failures.
failures=$(( ${{SLURM_RESTART_COUNT:-0}} - $(cat "$saved" 2>/dev/null | wc -l) ))
if [ "$failures" -lt {retries} ]; then
    scontrol requeue "$task"
    if [ -n "$nothing" ]; then  # this node would fail at pack after pack, and fast
        before=$(scontrol show job "$task" | sed -n 's/.*ExcNodeList=\\([^ (]*\\).*/\\1/p')
        scontrol update "JobId=$task" "ExcNodeList=${{before:+$before,}}$SLURMD_NODENAME"
    fi
fi
exit "$code"
"""

MERGE = """\
#!/bin/bash
# Runs when every task has ended, however it did; what is missing is named, and the next merge adds it.
{options}
#SBATCH --requeue
#SBATCH --open-mode=append

{command} --out {directory} --merge
code=$?
if [ "$code" -ge 126 ] && [ "$code" -le 127 ] && [ "${{SLURM_RESTART_COUNT:-0}}" -lt {retries} ]; then
    scontrol requeue "$SLURM_JOB_ID"  # there is no Python on this node
    scontrol update "JobId=$SLURM_JOB_ID" "ExcNodeList=$SLURMD_NODENAME"
fi
exit "$code"
"""
