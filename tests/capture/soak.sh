#!/bin/sh
# soak.sh PROGRAM FEED SECONDS - captures from a pipe and from a simulation at 30 frames a second for so long, at
# the same time: every frame must be accounted for, and resident memory must not grow. Ends with a line of sums.
#
# RUN       runs a program of another machine here
set -u

program=$1 feed=$2 seconds=$3
scratch=$(mktemp -d) || exit 1
began=$(date +%s)
pids=
# shellcheck disable=SC2086
trap 'kill $pids 2>/dev/null; rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM

# Memory is compared from the time on when all buffers have been used; the slack is the allocator's.
settled=$((seconds / 4))
[ $settled -le 30 ] || settled=30
slack_kb=1024
passed=0 failed=0

say() { # NAME RESULT WHY
    printf 'soak %-23s %s%s\n' "$1" "$2" "${3:+: $3}"
    if [ "$2" = passed ]; then passed=$((passed + 1)); else failed=$((failed + 1)); fi
}

check() { # NAME WHAT HAPPENED, as a condition of test
    name=$1 why=$2
    shift 2
    if [ "$@" ]; then say "$name" passed "$why"; else say "$name" FAILED "$why"; fi
}

total() { # NAME KEY: a number of the totals of NAME's recording
    sed -n 's/.*"totals": {\(.*\)}.*/\1/p' "$scratch/$1/frames.json" | tr ',' '\n' | sed -n "s/.*\"$2\": //p"
}

resident() { # PID: kB
    sed -n 's/^VmRSS:[^0-9]*\([0-9]*\) kB/\1/p' "/proc/$1/status" 2>/dev/null
}

# Samples memory of the recordings until they end: NAME SECOND KB a line.
sample() { # NAME PID
    while kill -0 "$2" 2>/dev/null; do
        kb=$(resident "$2")
        [ -z "$kb" ] || echo "$(($(date +%s) - began)) $kb" >>"$scratch/$1.memory"
        sleep 1
    done
}

check_memory() { # NAME
    first=$(awk -v s=$settled '$1 <= s { kb = $2 } END { print kb + 0 }' "$scratch/$1.memory")
    most=$(awk -v s=$settled '$1 > s && $2 > kb { kb = $2 } END { print kb + 0 }' "$scratch/$1.memory")
    check "$1-memory" "$first kB after $settled s, at most $most kB later" "$most" -gt 0 -a "$most" -le $((first + slack_kb))
}

# What was given is kept, passed over or lost by the writer.
check_given() { # NAME
    given=$(total "$1" given) rest=$(($(total "$1" kept) + $(total "$1" passed_over) + $(total "$1" undecodable) + \
        $(total "$1" dropped_by_writer)))
    check "$1-given" "$given given, $rest of them kept, passed over or lost" "$given" -eq $rest -a "$given" -gt 0
}

# Each frame's number, in its first 8 bytes, is the sequence that frames.json tells.
check_numbers() { # NAME BYTES
    sed -n 's/.*"sequence": \([0-9]*\).*/\1/p' "$scratch/$1/frames.json" >"$scratch/told"
    cat "$scratch/$1"/images/* | od -An -v -t u8 -w"$2" | awk '{ print $1 }' >"$scratch/seen"
    check "$1-numbers" "$(wc -l <"$scratch/seen") pictures compared" "$(cmp "$scratch/told" "$scratch/seen" 2>&1)" = ""
}

# RUN is a command and its arguments.
# shellcheck disable=SC2086
capture() { # NAME SOURCE OPTION...
    name=$1
    shift
    exec ${RUN:-} "$program" capture "$@" -o "$scratch/$name" --quiet --threads 1 2>"$scratch/$name.err"
}

mkfifo "$scratch/frames"
# shellcheck disable=SC2086
${RUN:-} "$feed" 64x48 30 "$seconds" >"$scratch/frames" 2>"$scratch/sent" &
pids=$!
capture pipe "pipe:$scratch/frames?live=1" --format raw --every 10 &
pipe=$!
capture sim 'sim:studio?width=64&height=48&fps=30&loop=1' --seconds "$seconds" --every 30 &
sim=$!
pids="$pids $pipe $sim"
sample pipe $pipe &
sampler=$!
pids="$pids $sampler"
sample sim $sim
wait $pipe
pipe_code=$?
wait $sim
sim_code=$?
wait $sampler

check pipe-end "exit code $pipe_code $(cat "$scratch/pipe.err")" $pipe_code = 0
check sim-end "exit code $sim_code $(cat "$scratch/sim.err")" $sim_code = 0
sent=$(sed -n 's/^sent //p' "$scratch/sent")
counted=$(($(total pipe given) + $(total pipe dropped) + $(total pipe skipped) + $(total pipe damaged)))
check pipe-frames "$sent sent, $(total pipe given) given, $(total pipe dropped) dropped" "$sent" -eq $counted
check_given pipe
check_numbers pipe $((64 * 48 * 3 / 2))
check_memory pipe
due=$((seconds * 30 + 1)) # the one that ended it, too
counted=$(($(total sim given) + $(total sim dropped)))
check sim-frames "$due due, $(total sim given) given, $(total sim dropped) dropped" \
    $counted -ge $due -a $counted -le $((due + 30))
check_given sim
check_memory sim
echo "$passed passed, $failed failed, 0 skipped"
[ $failed = 0 ]
