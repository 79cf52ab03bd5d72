#!/bin/sh
# run.sh PROGRAM... - runs cmocka programs, and scripts that print TAP as they do, shows what failed or was
# skipped and why, and sums up.
#
# RUN       runs a program of another machine here, for example "qemu-aarch64-static -L DIR"; scripts do that
# TIMEOUT   seconds that one program may take, 300 if unset
# SHOW      1: also prints the figures that passed tests print
set -u

if [ $# = 0 ]; then
    echo "run.sh: there is no such test" >&2
    exit 1
fi
here=$(dirname "$0")
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM
export CMOCKA_MESSAGE_OUTPUT=TAP
# What has nothing of a machine is not emulated.
[ -z "${RUN:-}" ] || export SPLATFIT_EMULATED=1
# Sanitizers: a refused allocation is for the program to handle, a crash is reported before cmocka catches it.
export ASAN_OPTIONS="${ASAN_OPTIONS:-allocator_may_return_null=1:handle_segv=2:handle_sigfpe=2}"
export TSAN_OPTIONS="${TSAN_OPTIONS:-allocator_may_return_null=1}"
export UBSAN_OPTIONS="${UBSAN_OPTIONS:-print_stacktrace=1}"

: >"$scratch/sums"
for program in "$@"; do
    began=$(date +%s)
    case $program in *.sh) start= ;; *) start=${RUN:-} ;; esac
    # RUN is a command and its arguments.
    # shellcheck disable=SC2086
    timeout --foreground -k 10 "${TIMEOUT:-300}" $start "$program" >"$scratch/out" 2>&1 </dev/null
    status=$?
    awk -v name="$(basename "$program")" -v status=$status -v seconds=$(($(date +%s) - began)) \
        -v limit="${TIMEOUT:-300}" -v show="${SHOW:-0}" -v sums="$scratch/sums" -f "$here/tap.awk" "$scratch/out"
done

awk -v expected=$# -f "$here/sums.awk" "$scratch/sums"
