#!/bin/sh
# page.sh NAME PROGRAM... - a page of the manual on standard output: splatfit, or splatfit-COMMAND.
#
# PROGRAM is how the program is started, which says what its tables say. NAME.man beside this script is what is written
# by hand: what comes before its first .SH goes into the description, or for splatfit begins the page; the rest ends it.
set -eu

name=$1
shift
here=$(dirname "$0")
command=${name#splatfit}
command=${command#-}
# No command is no argument.
# shellcheck disable=SC2086
"$@" help --man $command >"${TMPDIR:-/tmp}/page.$$"
trap 'rm -f "${TMPDIR:-/tmp}/page.$$"' EXIT
awk -v hand="$here/$name.man" -v whole="$([ "$name" = splatfit ] && echo 1 || echo 0)" '
    BEGIN {
        while ((getline line <hand) > 0) {
            if (line ~ /^\.\\"/) continue
            if (line ~ /^\.SH/ && !(whole && line ~ /NAME|SYNOPSIS|DESCRIPTION/)) rest = 1
            if (rest) last = last line "\n"; else first = first line "\n"
        }
    }
    $0 == "@DESCRIPTION@" { printf "%s", first; next }
    { print }
    END { printf "%s", last }' "${TMPDIR:-/tmp}/page.$$"
