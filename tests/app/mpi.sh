#!/bin/bash
# mpi.sh - fits on several ranks that mpirun starts, by the MPI that the program is built with; without one, what it says then.
#
# MPIRUN          the launcher (mpirun.openmpi or mpirun.mpich, as the program says that it is built)
# SPLATFIT_QUICK  two ranks and short fits alone, for sanitizers
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"

# As root, more ranks than processors, and without another network than this machine's.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
built=$(splatfit info --build)
kind=
grep -q '^ompi-c  *[0-9]' <<<"$built" && kind=openmpi
grep -q '^mpich  *[0-9]' <<<"$built" && kind=mpich
mpirun=${MPIRUN:-mpirun.$kind}

scene='sim:studio?width=96&height=72&frames=9'
fit=(fit "$scene" --seed 1 --max-gaussians 3000 --threads 1 --progress none --cameras none)
steps=${SPLATFIT_QUICK:+40}
steps=${steps:-150}
must() { # WHAT FILE: it is in the file
    grep -q -e "$1" "$2" || { echo "not there: $1"; cat -v "$2"; return 1; }
}

without() {
    OMPI_COMM_WORLD_SIZE=2 splatfit "${fit[@]}" --steps 5 -o "$scratch/no.ply" >"$scratch/no" 2>&1 && return 1
    must 'built without MPI' "$scratch/no" && [ ! -e "$scratch/no.ply" ]
}
if [ -z "$kind" ]; then
    check "a program without MPI refuses to be one of several" without
    skip "fits on several ranks" "the program is built without MPI (make MPI=openmpi or MPI=mpich)"
    finish
    exit
fi
if ! command -v "$mpirun" >/dev/null; then
    skip "fits on several ranks" "$mpirun is not there"
    finish
    exit
fi

ranks() { # N ARGUMENT...
    local n=$1 more=()
    shift
    [ $kind = mpich ] || more=(--oversubscribe --mca btl_base_warn_component_unused 0)
    # shellcheck disable=SC2086 # RUN is a command and its arguments.
    timeout 120 "$mpirun" -n "$n" "${more[@]}" ${RUN:-} "$program" "$@"
}

one() {
    splatfit "${fit[@]}" --steps "$steps" -o "$scratch/alone.ply" && ranks 1 "${fit[@]}" --steps "$steps" -o "$scratch/one.ply" &&
        cmp "$scratch/alone.ply" "$scratch/one.ply"
}
refined() {
    ranks 2 "${fit[@]}" --refine-poses --refine-intrinsics --refine-start 0 --steps 60 -o "$scratch/refined.ply" >"$scratch/refined" &&
        must 'poses corrected, in the median by 0\.[0-9]* degrees' "$scratch/refined"
}
check "one rank writes the bytes of a run without mpirun" one

several() { # N
    ranks "$1" "${fit[@]}" --steps "$steps" --log "$scratch/$1.json" -o "$scratch/$1.ply" >"$scratch/$1.out" &&
        ranks "$1" "${fit[@]}" --steps "$steps" -o "$scratch/$1-again.ply" >/dev/null &&
        cmp "$scratch/$1.ply" "$scratch/$1-again.ply" && [ "$(grep -c '^wrote' "$scratch/$1.out")" = 1 ] &&
        [ "$(grep -c '^rank [0-9]*: peak memory' "$scratch/$1.out")" = "$1" ]
}
# What the steps sent is within 10 % of the formula of src/cluster/README.md, which is for bands of several rows of tiles.
as_designed() {
    local off
    off=$(sed -n 's/^steps of all ranks: .* kB sent in each, .* designed, [-+]\([0-9]*\)\.[0-9] %$/\1/p' "$scratch/2.out")
    if [ -z "$off" ] || [ "$off" -ge 10 ]; then
        grep '^steps of' "$scratch/2.out"
        return 1
    fi
}
check "two ranks write the same bytes each time, and one of them speaks" several 2
check "they send as many bytes in a step as designed" as_designed
if [ -n "${SPLATFIT_QUICK:-}" ]; then
    check "poses and focal lengths are refined" refined
    finish
    exit
fi
check "four ranks, too" several 4

# The PSNR of the held-out views, in hundredths of a dB.
psnr() { splatfit eval "$1" "$scene" --json "$scratch/eval.json" >/dev/null 2>&1 && sed -n 's/^ *"psnr": \([0-9]*\)\.\([0-9][0-9]\).*/\1\2/p' "$scratch/eval.json" | tail -n 1; }
quality() {
    local alone of n
    alone=$(psnr "$scratch/alone.ply")
    for n in 2 4; do
        of=$(psnr "$scratch/$n.ply")
        echo "$n ranks: $of, one: $alone"
        [ -n "$of" ] && [ $((of + 30)) -ge "$alone" ] || return 1
    done
}
check "several ranks fit as well as one" quality

# All ranks draw, one writes: pictures of moments, held-out views at them, a comparison.
watched() {
    ranks 2 "${fit[@]}" --steps "$steps" --eval-at 0.01,0.1 --snapshots "$scratch/shots" --compare "$scratch/pair.png" --log "$scratch/watched.json" \
        -o "$scratch/watched.ply" >/dev/null && cmp "$scratch/watched.ply" "$scratch/2.ply" && [ -s "$scratch/pair.png" ] &&
        [ "$(grep -c '"psnr"' "$scratch/watched.json")" -ge 3 ]
}
check "evaluations, snapshots and a comparison change nothing" watched

check "poses and focal lengths are refined" refined

# Photos whose cameras nobody knows: rank 0 finds them, once, and all fit them.
photos() {
    splatfit capture 'sim:studio?width=320&height=240&frames=24' --frames 6 --format png -q -o "$scratch/taken" &&
        mv "$scratch/taken/images" "$scratch/photos" &&
        ranks 2 fit "$scratch/photos" --seed 1 --steps 20 --threads 1 --progress none -o "$scratch/photos.ply" >"$scratch/found" 2>&1 &&
        [ "$(grep -c 'of 6 photos placed' "$scratch/found")" = 1 ] && [ -s "$scratch/photos.project/sparse/0/images.bin" ] &&
        ranks 2 fit "$scratch/photos" --seed 1 --steps 20 --threads 1 --progress none -o "$scratch/photos-again.ply" >"$scratch/found" 2>&1 &&
        [ "$(grep -c 'found before' "$scratch/found")" = 1 ] && cmp "$scratch/photos.ply" "$scratch/photos-again.ply" && return
    cat -v "$scratch/found"
    return 1
}
check "one rank finds the cameras of photos for all" photos
no_photos() { # what rank 0 says, and all end
    mkdir "$scratch/none" && echo "no picture" | tee "$scratch/none/a.jpg" >"$scratch/none/b.jpg"
    ranks 2 fit "$scratch/none" -o "$scratch/none.ply" >"$scratch/said" 2>&1 && return 1
    must 'photo' "$scratch/said" && [ ! -e "$scratch/none.ply" ]
}
check "a folder without a photo that can be read ends all ranks" no_photos

# The processes of the ranks that write a file of this name.
ranks_of() { # NAME
    pgrep -f -- "-o $scratch/$1" | while read -r pid; do [ "$(readlink "/proc/$pid/exe")" = "$program" ] && echo "$pid"; done
}
# Starts two ranks that do not end, and waits until they are there: run, pids.
start() { # NAME ARGUMENT...
    local name=$1
    shift
    ranks 2 "${fit[@]}" "$@" --steps 1000000 -o "$scratch/$name.ply" >"$scratch/$name" 2>&1 &
    run=$!
    for _ in $(seq 100); do
        sleep 0.1
        pids=$(ranks_of "$name.ply")
        [ "$(wc -w <<<"$pids")" = 2 ] && grep -q '^memory' "$scratch/$name" && break
    done
    sleep 0.5
}

killed() {
    start killed --checkpoint "$scratch/killed.checkpoint" --checkpoint-every 0
    kill -KILL "$(tail -n 1 <<<"$pids")" || return 1
    wait "$run" && return 1
    for _ in $(seq 50); do
        [ -z "$(ranks_of killed.ply)" ] && break
        sleep 0.1
    done
    [ ! -e "$scratch/killed.ply" ] && [ -z "$(ranks_of killed.ply)" ] && must "$(uname -n)\|KILLED BY SIGNAL\|signal 9" "$scratch/killed"
}
[ -n "${RUN:-}" ] || check "a rank that is killed ends the run" killed

# What the killed run last wrote, gone on from by other numbers of ranks.
resumed() {
    local n
    for n in 1 4; do
        ranks $n fit "$scene" --resume "$scratch/killed.checkpoint" --steps 200 --threads 1 --progress none --cameras none \
            -o "$scratch/resumed-$n.ply" || return 1
        splatfit info "$scratch/resumed-$n.ply" >/dev/null || return 1
    done
}
[ -n "${RUN:-}" ] || check "its last checkpoint is whole, and another number of ranks goes on" resumed

# A signal to any of the ranks stops all at the same step.
stopped() {
    start stopped
    kill -TERM "$(tail -n 1 <<<"$pids")" || return 1
    wait "$run" && return 1
    must 'stopped: signal 15' "$scratch/stopped" && splatfit info "$scratch/stopped.ply" >/dev/null
}
[ -n "${RUN:-}" ] || check "a signal writes the model of all ranks" stopped
finish
