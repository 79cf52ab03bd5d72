#!/bin/bash
# against.sh - what make bench PARTS=against prints of two programs, and what it says of one that is not there.
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"
against() { PROGRAM=$program AGAINST='' "$(dirname "$0")/../bench/against.sh" "$@"; }

# The program against itself: everything but the time is the same.
itself() {
    against "$program" quick >"$scratch/table" || return 1
    awk -F ' *[|] *' '
        $3 ~ /^(seconds, all|user)/ { timed += $4 > 0 && $6 > 0 }
        $3 == "seconds, steps" { timed += $4 ~ /^[0-9]/ }
        $3 == "Gaussians" { same += $4 > 0 && $4 == $5 && $6 == "1.000" }
        $3 ~ /^(PSNR|SSIM)/ { same += $4 > 0 && $4 == $5 && $6 == "+0.0000" }
        $3 ~ /^peak/ { same += $4 > 0 && $6 > 0.5 && $6 < 2 }
        END { exit !(timed == 3 && same == 4) }' "$scratch/table" || { cat "$scratch/table"; return 1; }
}
refuses() { # TEXT ARGUMENT...: one line that has the text
    local text=$1
    shift
    if against "$@" >"$scratch/out" 2>"$scratch/said"; then return 1; fi
    cat "$scratch/said"
    [ ! -s "$scratch/out" ] && [ "$(wc -l <"$scratch/said")" = 1 ] && grep -qF -- "$text" "$scratch/said"
}
check "a table of a program against itself" itself
check "a program that is missing" refuses "$scratch/none: there is no such program" "$scratch/none"
check "no program named" refuses "AGAINST is not set"
: >"$scratch/text" && chmod -x "$scratch/text"
check "a file that is no program" refuses "$scratch/text: does not run here" "$scratch/text"
finish
