#!/bin/bash
# ci.sh - all that is checked before a change is taken: each step's failures and skips, then one line of sums.
#
# A step that ends with a line of sums counts with these, any other as one that passed or failed.
set -uo pipefail

cd "$(dirname "$0")/.." || exit 1
logs=build/ci
mkdir -p $logs
: >$logs/sums
sums='[0-9]+ passed, [0-9]+ failed, [0-9]+ skipped'
make=(env WERROR=1 "${MAKE:-make}" --no-print-directory "-j$(nproc)")
# An emulated or instrumented program sees no real scenes, and slow tests do less.
quick=(env -u SPLATFIT_DATA SPLATFIT_QUICK=1)

step() { # NAME COMMAND...
    local name=$1 log=$logs/$1.log began=$SECONDS status
    shift
    echo "== $name"
    "$@" 2>&1 | tee "$log" | sed -uE "/^(CC|AR|LD)    /d; /^passed  /d; /^$sums\$/d"
    status=$?
    local result
    result=$(grep -xE "$sums" "$log" | tail -n 1)
    case $status:$result in
    0:?*) ;;
    0:) result="1 passed, 0 failed, 0 skipped" ;;
    *:*", 0 failed,"* | *:) result="0 passed, 1 failed, 0 skipped" ;;
    esac
    echo "$result" >>$logs/sums
    echo "== $name: $result ($((SECONDS - began)) s)"
}

emulated() { # NAME TOOLCHAIN
    local run=("${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN="$2")
    step "$1" "${run[@]}" test
    step "$1-levels" "${run[@]}" check
    step "$1-cpus" "${run[@]}" check-cpus
}

step lint "${make[@]}" lint
step gcc "${make[@]}" test
step levels "${make[@]}" check
step clang "${quick[@]}" "${make[@]}" CC=clang test
step address "${quick[@]}" "${make[@]}" CC=clang SAN=address,undefined test
step thread "${quick[@]}" "${make[@]}" SAN=thread TESTS="pool context scene render fit pipe capture" test
# Emulated programs keep one CPU busy each: the slowest machine goes beside all that follows up to the wait.
emulated armhf arm-linux-gnueabihf >$logs/armhf.out &
emulated aarch64 aarch64-linux-gnu
step cpus env TIMEOUT=900 "${make[@]}" check-cpus
step mutants "${make[@]}" mutants
wait
cat $logs/armhf.out
step bench "${make[@]}" bench-quick
step charts "${make[@]}" charts-quick
# The boards' own flags are tried on the way.
for target in native aarch64-linux-gnu arm-linux-gnueabihf rpi5 rpi4 rpi-zero2 jetson; do
    step static-$target "${make[@]}" TOOLCHAIN=$target STATIC=1 test-static
done
step soak "${make[@]}" soak SECONDS=20
step vm "${make[@]}" test-vm
step install "${make[@]}" test-install
step demo "${make[@]}" demo DEMO_FLAGS="--steps 20"
step scenes env TIMEOUT=1200 "${make[@]}" test-scenes

awk '{ passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0
     }' $logs/sums | tee $logs/result
