#!/bin/bash
# report.sh - what splatfit bench --report prints: each table with a figure for every level of this machine.
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"

levels=$(splatfit info --cpu | grep -cE '(usable|in use)$')
report() {
    splatfit bench --report --quick --quiet >"$scratch/report" || return 1
    head -n 1 "$scratch/report" | grep -qE '^### splatfit [0-9.]+ on .' || { head -n 1 "$scratch/report"; return 1; }
    local row
    for row in 'project, Gaussian' 'blend, contributing pair' 'project_bwd, Gaussian' 1 picture gradient; do
        grep "^| $row |" "$scratch/report" >"$scratch/row"
        # The row's own name, and a number a level.
        awk -F '|' -v levels="$levels" '{ for (i = 3; i < NF; i++) if ($i + 0 > 0) n++ } END { exit !(NR == 1 && n == levels) }' \
            "$scratch/row" || { echo "$row: not $levels figures:"; cat "$scratch/report"; return 1; }
    done
}
check "a figure for every level" report
finish
