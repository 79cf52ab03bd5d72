#!/bin/bash
# bench.sh [quick] - what make bench measures, into build/: speed and accuracy of this program, cameras from photos, and
# this program beside another build's. quick: whether it works.
#
# PARTS         which of measure, sfm and against; if unset the first two, and against where AGAINST is set
# AGAINST       another build's program; measure draws its accuracy and speed, too
# LEVELS        of this machine
# BENCH_FLAGS   of splatfit bench, e.g. --quick
# PROGRAM, RUN, SPLATFIT_DATA: as for charts.sh. Of against also what against.sh says.
set -euo pipefail

kind=${1:-full}
program=${PROGRAM:-build/splatfit}
here=$(dirname "$0")
parts=${PARTS:-measure sfm ${AGAINST:+against}}
mkdir -p build

# RUN, LEVELS and BENCH_FLAGS are words. Instructions are counted first, where valgrind is there, and go into the report.
# shellcheck disable=SC2086
measure() {
    "$here/callgrind.sh" build/bench-instructions.txt ${LEVELS:-}
    local before=()
    if [ -n "${AGAINST:-}" ]; then
        ${RUN:-} "$AGAINST" bench --only accuracy --json build/bench-before.json -q ${BENCH_FLAGS:-}
        before=(--before build/bench-before.json)
    fi
    ${RUN:-} "$program" bench --json build/bench.json --svg build --instructions build/bench-instructions.txt "${before[@]}" ${BENCH_FLAGS:-}
}
sfm() { "$here/sfm.sh" >build/bench-sfm.txt && cat build/bench-sfm.txt; }
against() { "$here/against.sh" "${AGAINST:-}" >build/bench-against.md && cat build/bench-against.md; }

for part in $parts; do
    case $part in
    measure | sfm | against) ;;
    *)
        echo "bench.sh: PARTS: \"$part\" is none of measure, sfm and against" >&2
        exit 2
        ;;
    esac
done
if [ "$kind" = quick ]; then
    # shellcheck disable=SC2086
    ${RUN:-} "$program" bench --quick --json build/bench-quick.json >build/bench-quick.txt
    "$here/against.sh" "${AGAINST:-$program}" quick >>build/bench-quick.txt
    exit
fi
for part in $parts; do "$part"; done
