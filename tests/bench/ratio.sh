#!/bin/bash
# ratio.sh BEFORE AFTER ARGUMENT... - what a change of the program does to its speed: both programs run the same command in turn,
# and what is printed is the ratio of their processor times, after / before: the median of all rounds, the least and the most.
#
# ROUNDS   5 if unset; each round runs both, the other one first every second time
set -euo pipefail

[ $# -ge 3 ] || { echo "usage: ratio.sh BEFORE AFTER ARGUMENT..." >&2; exit 2; }
before=$1 after=$2
shift 2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
TIMEFORMAT='%U %S'
seconds() { # PROGRAM ARGUMENT...: its processor time
    { time "$@" >/dev/null 2>"$scratch/said"; } 2>"$scratch/time" || {
        echo "ratio.sh: $* failed: $(tail -n 1 "$scratch/said")" >&2
        return 1
    }
    awk '{ print $1 + $2 }' "$scratch/time"
}
for ((round = 1; round <= ${ROUNDS:-5}; round++)); do
    if ((round % 2)); then
        b=$(seconds "$before" "$@")
        a=$(seconds "$after" "$@")
    else
        a=$(seconds "$after" "$@")
        b=$(seconds "$before" "$@")
    fi
    echo "$b $a" | awk '{ printf "before %6.2f s, after %6.2f s: %.3f\n", $1, $2, $2 / $1 }' | tee -a "$scratch/rounds"
done
sed 's/.*: //' "$scratch/rounds" | sort -n | awk '
    { r[NR] = $1 }
    END {
        printf "after / before: %.3f (%.3f to %.3f)\n", NR % 2 ? r[(NR + 1) / 2] : (r[NR / 2] + r[NR / 2 + 1]) / 2, r[1], r[NR]
    }'
