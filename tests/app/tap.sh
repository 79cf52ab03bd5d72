# shellcheck shell=bash
# tap.sh - for the scripts beside it: each checks the program and says so as the Test Anything Protocol has it.
#
# RUN               runs a program of another machine here
# SPLATFIT_PROGRAM  the program (build/splatfit)

program=$(realpath "${SPLATFIT_PROGRAM:-build/splatfit}")
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM
number=0

# RUN is a command and its arguments.
# shellcheck disable=SC2086
splatfit() { ${RUN:-} "$program" "$@"; }

check() { # NAME COMMAND...: the command succeeds
    local name=$1 said
    shift
    number=$((number + 1))
    if said=$("$@" 2>&1); then
        echo "ok $number - $name"
    else
        [ -z "$said" ] || echo "$said"
        echo "not ok $number - $name"
    fi
}

skip() { # NAME WHY
    number=$((number + 1))
    echo "skipped: $2"
    echo "ok $number - $1 # SKIP"
}

finish() { echo "1..$number"; }
