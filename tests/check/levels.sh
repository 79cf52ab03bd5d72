#!/bin/sh
# levels.sh "PROGRAM..." "PROGRAM..." LEVEL... - runs the first programs once at each level that this machine has, then
# the others, and sums up.
#
# RUN      as in tests/run.sh
# PROGRAM  splatfit
set -u

here=$(dirname "$0")
each=$1 once=$2
shift 2
sums=$(mktemp) || exit 1
trap 'rm -f "$sums"' EXIT

# Names of programs are words.
# shellcheck disable=SC2086
for level in "$@"; do
    if SPLATFIT_ISA=$level ${RUN:-} "$PROGRAM" info --cpu >/dev/null 2>&1; then
        echo "-- $level"
        SPLATFIT_ISA=$level "$here/../run.sh" $each
    else
        echo "-- $level: not on this machine: skipped"
        echo "0 passed, 0 failed, 1 skipped"
    fi | tee -a "$sums" | grep -vE '^[0-9]+ passed'
done
# shellcheck disable=SC2086
SHOW=1 "$here/../run.sh" $once | tee -a "$sums" | grep -vE '^[0-9]+ passed'

awk '/^[0-9]+ passed/ { passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0 || passed == 0
     }' "$sums"
