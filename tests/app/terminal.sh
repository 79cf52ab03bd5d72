#!/bin/bash
# terminal.sh - progress and messages on a terminal, on one that can do nothing, in a log, for a program.
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"

if ! script -qec true /dev/null </dev/null >/dev/null 2>&1; then
    skip terminal "script(1) is not there"
    finish
    exit
fi

escape=$'\033'
scene='sim:studio?width=64&height=48&frames=9'
fit=(fit "$scene" --max-gaussians 400 --cameras none -o "$scratch/m.ply")
quoted() { printf '%q ' "$@"; }
# on_terminal FILE COMMAND...: on a terminal of 60 columns
on_terminal() {
    local file=$1
    shift
    # shellcheck disable=SC2086 # RUN is a command and its arguments.
    script -qec "stty cols 60; $(quoted ${RUN:-} "$program" "$@")" /dev/null </dev/null >"$file" 2>&1
}
must() { # WHAT FILE: it is in the file
    grep -q -e "$1" "$2" || { echo "not there: $1"; cat -v "$2"; return 1; }
}
must_not() {
    ! grep -q -e "$1" "$2" || { echo "there: $1"; cat -v "$2"; return 1; }
}

bar() {
    TERM=xterm on_terminal "$scratch/bar" "${fit[@]}" --steps 60 || return 1
    must "$escape\[K\[#*\.*\] *[0-9]* %" "$scratch/bar" && must 'ETA [0-9]*:[0-9][0-9]\|step 60/60' "$scratch/bar" || return 1
    # No line is as wide as the terminal, or it would break.
    tr '\r' '\n' <"$scratch/bar" | grep -a "$escape\[K" | sed "s/$escape\[K//" | awk 'length > 59 { print; bad = 1 } END { exit bad }'
}
check "a bar that keeps within its line" bar

dumb() {
    TERM=dumb on_terminal "$scratch/dumb" "${fit[@]}" --steps 20 || return 1
    must_not "$escape" "$scratch/dumb" && must 'step 20/20' "$scratch/dumb"
}
check "plain lines with TERM=dumb" dumb

colour() {
    TERM=xterm on_terminal "$scratch/said" info "$scratch/nothing" && return 1
    must "$escape\[1;31msplatfit info:$escape\[0m " "$scratch/said" || return 1
    NO_COLOR=1 TERM=xterm on_terminal "$scratch/said" info "$scratch/nothing" && return 1
    must_not "$escape" "$scratch/said" && must '^splatfit info: ' "$scratch/said" || return 1
    TERM=dumb on_terminal "$scratch/said" info "$scratch/nothing" && return 1
    must_not "$escape" "$scratch/said"
}
check "colour on a terminal alone, not with NO_COLOR or TERM=dumb" colour

log() {
    TERM=xterm splatfit "${fit[@]}" --steps 20 >"$scratch/out" 2>"$scratch/err" </dev/null || return 1
    cat "$scratch/out" "$scratch/err" >"$scratch/log"
    must_not "$escape" "$scratch/log" && must_not $'\r' "$scratch/log" && must '^step 20/20 ' "$scratch/log"
}
check "whole lines in a log" log

json() {
    splatfit "${fit[@]}" --steps 20 --progress json --quiet >"$scratch/json" 2>/dev/null </dev/null || return 1
    must '^{"step": 20, .*"eta_seconds": .*}$' "$scratch/json" || return 1
    ! command -v python3 >/dev/null ||
        python3 -c 'import json, sys; [json.loads(l) for l in open(sys.argv[1]) if l.startswith("{")]' "$scratch/json"
}
check "an object a line for programs" json
finish
