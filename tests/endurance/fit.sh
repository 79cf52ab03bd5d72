#!/bin/sh
# fit.sh - a fit of an hour, with a checkpoint every minute and views kept out to validate: its resident memory must not grow
# in the second half beyond what its Gaussians explain, and its last checkpoint gives its model.
#
# FIT_SECONDS       how long (3600)
# THREADS           of the fit (all)
# SPLATFIT_DATA     folder of real scenes: the fox of it, otherwise the embedded scene
# SPLATFIT_PROGRAM  the program (build/splatfit)
set -u

program=${SPLATFIT_PROGRAM:-build/splatfit} seconds=${FIT_SECONDS:-3600} project='sim:studio?width=160&height=120'
[ -z "${SPLATFIT_DATA:-}" ] || project=$SPLATFIT_DATA/fox-centred-270
scratch=$(mktemp -d) || exit 1
pid=
# shellcheck disable=SC2086
trap 'kill $pid 2>/dev/null; rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM

every=$((seconds < 600 ? seconds / 10 : 60))
# A Gaussian with all its bands, as src/fit/memory.c bills it and more: parameters, moments and statistics, the best model,
# its pairs with tiles, the copy that a checkpoint is written from.
bytes=2048
# The allocator's.
slack_kb=4096
failures=0

check() { # WHAT HAPPENED, as a condition of test
    why=$1
    shift
    echo "$why"
    [ "$@" ] || {
        echo "that is wrong: $*"
        failures=$((failures + 1))
    }
}

# The time ends the run, and the views that are kept out do not.
"$program" fit "$project" -o "$scratch/m.ply" --time-limit "$seconds" --patience 0 --checkpoint "$scratch/c.fit" \
    --checkpoint-every $every --log "$scratch/l.json" --progress json ${THREADS:+--threads "$THREADS"} \
    >"$scratch/said" 2>"$scratch/errors" &
pid=$!

# A line a second: kB resident, seconds of the fit, Gaussians, when the checkpoint was written.
while kill -0 $pid 2>/dev/null; do
    kb=$(sed -n 's/^VmRSS:[^0-9]*\([0-9]*\) kB/\1/p' /proc/$pid/status 2>/dev/null)
    now=$(tail -n 1 "$scratch/said" | sed -n 's/.*"seconds": \([0-9.]*\),.*"gaussians": \([0-9]*\),.*/\1 \2/p')
    written=$(stat -c %.3Y "$scratch/c.fit" 2>/dev/null || echo 0)
    [ -z "$kb" ] || [ -z "$now" ] || echo "$kb $now $written" >>"$scratch/samples"
    sleep 1
done
wait $pid
code=$?
pid=

result() { # KEY
    sed -n "s/.*\"$1\": \"\{0,1\}\([a-z0-9.-]*\).*/\1/p" "$scratch/l.json" 2>/dev/null | tail -n 1
}
check "exit status $code $(tail -n 1 "$scratch/errors")" $code = 0
check "ended by $(result end) after $(result steps) steps with $(result gaussians) Gaussians" "$(result end)" = time
check "best of validation at step $(result best_step), $(result validation_psnr) dB" "$(result best_step)" -gt 0

# Reading the pictures is a part of the time that was asked for.
fitted=$(awk 'END { print int($2) }' "$scratch/samples")
# shellcheck disable=SC2046
set -- $(awk -v half="$((fitted / 2))" -v b=$bytes '
    $2 <= half { kb = $1; n = $3; next }
    { rows++; if ($1 > most) most = $1; if ($3 > top) top = $3; last = $1; end = $3 }
    END { print kb + 0, n + 0, most + 0, top + 0, last + 0, end + 0, int((top > n ? top - n : 0) * b / 1024), rows + 0 }' "$scratch/samples")
check "$1 kB with $2 Gaussians after $((fitted / 2)) s; then at most $3 kB and $4 Gaussians, at last $5 kB and $6; $8 samples" \
    "$8" -gt 0 -a "$1" -gt 0 -a "$3" -le $(($1 + $7 + slack_kb))
times=$(awk '$4 > 0 { print $4 }' "$scratch/samples" | sort -u | wc -l)
# One waits for the end of its step, which takes long where the machine has other work.
check "$times checkpoints in $fitted s, one every $every s" "$times" -gt 0 -a "$times" -ge $((fitted / every / 2))

"$program" fit "$project" -o "$scratch/again.ply" --resume "$scratch/c.fit" --quiet 2>"$scratch/errors"
apart=$(cmp "$scratch/m.ply" "$scratch/again.ply" 2>&1)
check "the model of the last checkpoint: ${apart:-the same} $(tail -n 1 "$scratch/errors")" "$apart" = ""
echo 1..1
if [ $failures = 0 ]; then echo "ok 1 - fit"; else echo "not ok 1 - fit"; fi
