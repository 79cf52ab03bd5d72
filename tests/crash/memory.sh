#!/bin/bash
# memory.sh - what a fit takes, growth, checkpoints and evaluation with it, is what --memory allows and what
# the forecast says.
#
# SCENES=1          whole scenes, also the real ones of SPLATFIT_DATA
# SPLATFIT_QUICK    not empty: of the whole scenes, those that take the least memory and time
# SHIM              empty: emulators and sanitizers take memory of their own
# SPLATFIT_PROGRAM  the program (build/splatfit)
set -u

if [ -z "${SHIM:-}" ]; then
    echo "skipped: emulators and sanitizers take memory of their own"
    printf '1..1\nok 1 - memory # SKIP\n'
    exit
fi
program=$(realpath "${SPLATFIT_PROGRAM:-build/splatfit}")
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM
cd "$scratch" || exit 1

failures=0
fail() {
    echo "$1"
    failures=$((failures + 1))
}

# The forecast may be above the peak by a third, where the fit has grown to what the memory holds.
fit() { # BUDGET_MB SCENE OPTION...
    local budget=$1 scene=$2 forecast cap peak grown
    shift 2
    # Growth doubles what is there until the cap is reached.
    "$program" fit "$scene" -o m.ply --memory "${budget}M" --max-gaussians 10000000 --size cap --steps 140 \
        --plan-steps 1000 --densify-per-step 1e6 --densify-every 8 --densify-rate 1 --densify-end 0.6 --checkpoint c.fit \
        --checkpoint-every 2 --log l.json --compare p.png --progress none "$@" >out 2>said || {
        fail "$scene, $budget MB: $(tail -n 1 said)"
        return
    }
    forecast=$(sed -n 's/^memory: about \([0-9]*\) MB of .*/\1/p' out)
    cap=$(sed -n 's/^memory: .* for \([0-9]*\) Gaussians: .*/\1/p' out)
    peak=$(sed -n 's/.*peak memory \([0-9]*\) MB.*/\1/p' out)
    grown=$(sed -n 's/^wrote m.ply: \([0-9]*\) .*/\1/p' out)
    echo "$scene $*: $budget MB allowed, $forecast forecast for $cap Gaussians, $peak taken by $grown"
    [ "$peak" -le "$budget" ] || fail "more than allowed"
    [ "$peak" -le "$forecast" ] || fail "more than forecast"
    [ $((grown * 10)) -ge $((cap * 9)) ] || fail "the fit has not grown to what the memory holds"
    [ $((forecast * 100)) -le $((peak * 135)) ] || fail "the forecast is far above"
}

if [ -z "${SCENES:-}" ]; then
    fit 40 'sim:studio?width=160&height=120&frames=18'
    fit 60 'sim:studio?width=160&height=120&frames=18' --moments half --exposure
elif [ -n "${SPLATFIT_QUICK:-}" ]; then
    fit 60 sim:studio
    fit 90 sim:studio --densify error --exposure
    [ -z "${SPLATFIT_DATA:-}" ] || fit 120 "$SPLATFIT_DATA/fox-centred-270"
else
    for budget in 60 120 200; do fit $budget sim:studio; done
    fit 90 sim:studio --moments half --validate 0
    fit 90 sim:studio --densify error --exposure
    fit 90 sim:studio --densify relocate
    if [ -n "${SPLATFIT_DATA:-}" ]; then
        for budget in 120 200; do fit $budget "$SPLATFIT_DATA/fox-centred-270"; done
        for budget in 200 300; do fit $budget "$SPLATFIT_DATA/rbt-tagboard"; done
    fi
fi
echo 1..1
if [ $failures = 0 ]; then echo "ok 1 - memory"; else echo "not ok 1 - memory"; fi
