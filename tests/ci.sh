#!/bin/bash
# ci.sh - all that is checked before a change is taken: each step's failures and skips, then one line of sums.
#
# A step that ends with a line of sums counts with these, any other as one that passed or failed.
set -uo pipefail

cd "$(dirname "$0")/.." || exit 1
logs=build/ci
mkdir -p $logs
: >$logs/sums
: >$logs/times
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
    echo "$((SECONDS - began)) $name" >>$logs/times
    echo "== $name: $result ($((SECONDS - began)) s)"
}

# Names of all tests but those given.
all_but() { # NAME...
    local file name
    for file in tests/{unit,golden,check,stability}/test_*.c; do
        name=${file##*/test_}
        name=${name%.c}
        [[ " $* " == *" $name "* ]] || echo "$name"
    done | sort -u | xargs
}

# Whole fits take minutes where they are emulated: of these tests, each machine leaves out what the other runs,
# and both what has nothing of a machine: all allocations, all moments of a fit, the program's words.
fits_64='exposure fit growth refine schedule sweep chart calibrate capture stability allocations guard cancel cli commands live sim_board'
fits_32='checkpoint cli commands bench guard cancel allocations live'
emulated() { # NAME TOOLCHAIN TESTS
    local run=("${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN="$2")
    step "$1" "${run[@]}" TESTS="$3" test
    step "$1-levels" "${run[@]}" check
    step "$1-cpus" "${run[@]}" check-cpus
}

step lint "${make[@]}" lint
step gcc "${make[@]}" test
step levels "${make[@]}" check
# A step that tests keeps little more than one CPU busy: two go side by side.
step thread "${quick[@]}" "${make[@]}" SAN=thread TESTS="pool context scene render fit cancel pipe capture preview live" test >$logs/thread.out &
# All tests as clang builds them run there; without sanitizers it only has to compile them.
step address "${quick[@]}" "${make[@]}" CC=clang SAN=address,undefined test
step clang "${make[@]}" CC=clang build-tests
wait
cat $logs/thread.out
# As many targets at a time as there are processors.
step fuzz "${make[@]}" fuzz
# Emulated programs keep one CPU busy each: the slowest machine goes beside all that follows up to the wait.
# shellcheck disable=SC2086
emulated armhf arm-linux-gnueabihf "$(all_but $fits_64)" >$logs/armhf.out &
# shellcheck disable=SC2086
emulated aarch64 aarch64-linux-gnu "$(all_but $fits_32)"
step cpus env TIMEOUT=900 "${make[@]}" check-cpus
step mutants "${make[@]}" mutants
wait
cat $logs/armhf.out
step bench "${make[@]}" bench-quick
step charts "${make[@]}" charts-quick
for target in native aarch64-linux-gnu arm-linux-gnueabihf rpi5; do
    step static-$target "${make[@]}" TOOLCHAIN=$target STATIC=1 test-static
done
# The other boards differ from rpi5 in a flag.
for target in rpi4 rpi-zero2 jetson; do
    step board-$target "${make[@]}" TOOLCHAIN=$target build/$target/src/kernels/context.o
done
step soak "${make[@]}" soak SECONDS=20
step vm "${make[@]}" test-vm
step install "${make[@]}" test-install
step outside "${make[@]}" test-outside
step demo "${make[@]}" demo DEMO_FLAGS="--steps 20"
step crash "${make[@]}" crash EVERY=15
step scenes env TIMEOUT=1200 "${make[@]}" test-scenes

# Where the time went: the steps, and each step's slowest programs.
echo "== seconds of $SECONDS: $(sort -rn $logs/times | awk '{ printf "%s %d, ", $2, $1 }')"
grep -HoE '^[a-z_0-9.]+ +[0-9]+ passed.*\([0-9]+ s\)' $logs/*.log | sed -E 's|.*/(.*)\.log:([^ ]+).*\(([0-9]+) s\)|\3 \1/\2|' |
    sort -rn | awk 'NR <= 30 { printf "%s %d, ", $2, $1 } END { print "" }'

awk '{ passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0
     }' $logs/sums | tee $logs/result
