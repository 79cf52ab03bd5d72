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
    "$@" 2>&1 | tee "$log" | sed -uE "/^(CC|AR|LD)    /d; /^$sums\$/d"
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

step lint "${make[@]}" lint
step gcc "${make[@]}" test
step levels "${make[@]}" check
step clang "${quick[@]}" "${make[@]}" CC=clang test
step address "${quick[@]}" "${make[@]}" CC=clang SAN=address,undefined test
step thread "${quick[@]}" "${make[@]}" SAN=thread TESTS="pool context scene render fit" test
step aarch64 "${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN=aarch64-linux-gnu test
step aarch64-levels "${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN=aarch64-linux-gnu check
step armhf "${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN=arm-linux-gnueabihf test
step armhf-levels "${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN=arm-linux-gnueabihf check
step install "${make[@]}" test-install
step demo "${make[@]}" demo DEMO_FLAGS="--steps 20"
step scenes env TIMEOUT=1200 "${make[@]}" test-scenes

awk '{ passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0
     }' $logs/sums | tee $logs/result
