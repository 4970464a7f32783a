#!/usr/bin/env bash
# Packs that cannot succeed, on a private Slurm cluster: one whose disk is full, one with a lane that meets a number that
# is not finite, and a node without Python. The others must be done, all of it named by --status and by the merge, and
# neither may end with 0. Then, on one machine, a sweep whose disk is full, which goes on once there is room.
#
#     tests/cluster/failing.sh
source "$(dirname "${BASH_SOURCE[0]}")/private_slurm.sh"
bring_up

named() {  # FILE WORDS...: every one is in the file
    local file=$1 words
    shift
    cat "$file"
    for words in "$@"; do grep -q -- "$words" "$file" || { echo "failed: nothing says: $words"; exit 1; }; done
}
ends_with() {  # CODE FILE COMMAND...
    local code=0
    "${@:3}" > "$2" 2>&1 || code=$?
    [ "$code" = "$1" ] || { cat "$2"; echo "failed: it ended with $code, not with $1"; exit 1; }
}

# A namespace in which there is nothing where Python was, and in it the second node.
kill "$(cat "$work/slurmd.n2.pid")"
unshare --mount bash -c "mount -t tmpfs none '$(dirname "$python")'; $(declare -f start_node); start_node n2"

lanes=(--preset smoke --algos ddpg --steps 800 --train.evaluate-every 160 --train.checkpoint-every 160
    --evaluation.episodes 2 --pack-lanes 2 --cpus 1 --seeds 4)
sweep "${lanes[@]}" --grid 'ddpg.critic-lr=.001;1e38' --engine slurm --time 10 --retries 3 --out "$work/sweep" --plan-only
mkdir -p "$work/sweep/packs/00001"
mount -t tmpfs -o size=32k none "$work/sweep/packs/00001"
sweep --out "$work/sweep" --resume
finished

ends_with 1 "$work/status" sweep --out "$work/sweep" --status
named "$work/status" '4 packs: 3 done, 1 failed' 'pack 00001 failed .*No space left on device' \
    'pack 00002 done .*not finite from step' 'pack 00003 done .*not finite from step'
ends_with 1 "$work/merge" sweep --out "$work/sweep" --merge
named "$work/merge" '3 of 4 packs merged' 'pack 00001 is missing: failed No space left on device' \
    'lane 4 (ddpg ddpg.critic-lr=1e38 .*was not finite' 'lane 7 (ddpg ddpg.critic-lr=1e38 .*was not finite'
cat "$work"/sweep/tasks/*/attempts.jsonl > "$work/attempts"
echo "$(grep -c 'there is no Python' "$work/attempts") attempts on the node without Python"

# A whole disk that is full, then one with room.
cache=$work/cache
mv "$work/sweep/cache" "$cache"
mkdir "$work/disk"
mount -t tmpfs -o size=256k none "$work/disk"
ends_with 0 "$work/plan" sweep "${lanes[@]}" --retries 1 --out "$work/disk/sweep" --plan-only
ln -s "$cache" "$work/disk/sweep/cache"
code=0
sweep --out "$work/disk/sweep" --resume > "$work/full" 2>&1 || code=$?
cat "$work/full"
[ "$code" != 0 ] || { echo "failed: it ended with 0 on a full disk"; exit 1; }
mount -o remount,size=64m "$work/disk"
ends_with 0 "$work/room" sweep --out "$work/disk/sweep" --resume
cat "$work/room"
umount "$work/disk"
echo "ok: what could not succeed was named, the rest was done"
