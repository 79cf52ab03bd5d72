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

# Whole fits take minutes where they are emulated, and what reads formats is the same on both but for its integers: of these
# tests, each machine leaves out what the other runs, and both what has nothing of a machine: all allocations, all moments of a
# fit, the program's words, charts, figures of time, how good fits get.
both='allocations bench blur cancel chart cli commands exposure first growth guard live refine schedule sim_board sweep validate'
only_64="calibrate capture fit insert landmarks outputs shown stability studio $both"
only_32="archive checkpoint colmap context degrees inputs $both"
emulated() { # NAME TOOLCHAIN TESTS
    local run=("${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN="$2")
    step "$1" "${run[@]}" TESTS="$3" test
    step "$1-levels" "${run[@]}" check
    step "$1-cpus" "${run[@]}" check-cpus
}

# Much of this keeps little more than one CPU busy: two lanes go side by side, and what the other one does is said where
# both have come to an end. They share no folder that either builds in.
declare -A lanes
lane() { # NAME COMMAND
    "$2" >"$logs/lane-$1.out" &
    lanes[$1]=$!
}
# The steps of a lane count by themselves; one that was killed never came to its last steps.
join() { # NAME
    local status=0
    wait "${lanes[$1]}" || status=$?
    cat "$logs/lane-$1.out"
    [ $status != 0 ] || return 0
    echo "0 passed, 1 failed, 0 skipped" >>$logs/sums
    echo "== lane-$1: ended with status $status before its last step"
}

# All tests as clang builds them run with sanitizers; without, it only has to compile the library and the program.
by_clang() { step clang "${make[@]}" CC=clang CFLAGS=-O0 KERNELS_O=0; }
# Refused blocks, and the moments of one fit after another, have nothing of threads.
by_threads() {
    step thread "${quick[@]}" TIMEOUT=900 SPLATFIT_EMULATED=1 "${make[@]}" SAN=thread TESTS="pool context scene render fit cancel pipe capture preview live" test
}
step lint "${make[@]}" lint
lane clang by_clang
step gcc "${make[@]}" test
step levels "${make[@]}" check
join clang
lane thread by_threads
step address "${quick[@]}" "${make[@]}" CC=clang SAN=address,undefined test
join thread
# As many targets at a time as there are processors; `make fuzz` alone takes twice as long.
step fuzz env FUZZ_SECONDS=10 "${make[@]}" fuzz

# shellcheck disable=SC2086
by_armhf() { emulated armhf arm-linux-gnueabihf "$(all_but $only_64)"; }
lane armhf by_armhf
# shellcheck disable=SC2086
emulated aarch64 aarch64-linux-gnu "$(all_but $only_32)"
step cpus env TIMEOUT=900 "${make[@]}" check-cpus
step mutants "${make[@]}" mutants
join armhf

# An emulated board, and sources that are slow on purpose, beside builds and what others say of our files.
by_cameras() {
    step vm "${make[@]}" test-vm
    step soak "${make[@]}" soak SECONDS=20
}
lane cameras by_cameras
for target in native arm-linux-gnueabihf; do
    step static-$target "${make[@]}" TOOLCHAIN=$target STATIC=1 test-static
done
# The boards differ from those in a flag.
for target in rpi5 rpi4 rpi-zero2 jetson; do
    step board-$target "${make[@]}" TOOLCHAIN=$target build/$target/src/kernels/context.o
done
step install "${make[@]}" test-install
step outside "${make[@]}" test-outside
join cameras
for target in native aarch64-linux-gnu arm-linux-gnueabihf; do
    step deb-$target "${make[@]}" TOOLCHAIN=$target test-deb
done

by_charts() {
    step bench "${make[@]}" bench-quick
    step charts "${make[@]}" charts-quick
    step demo "${make[@]}" demo DEMO_FLAGS="--steps 20"
}
lane charts by_charts
step crash "${make[@]}" crash KILLS=50 EVERY=15
join charts
# The blobs are some of them.
step scenes env SPLATFIT_QUICK=1 TIMEOUT=1200 "${make[@]}" test-scenes

# Where the time went: the steps, and each step's slowest programs.
echo "== seconds of $SECONDS: $(sort -rn $logs/times | awk '{ printf "%s %d, ", $2, $1 }')"
grep -HoE '^[a-z_0-9.]+ +[0-9]+ passed.*\([0-9]+ s\)' $logs/*.log | sed -E 's|.*/(.*)\.log:([^ ]+).*\(([0-9]+) s\)|\3 \1/\2|' |
    sort -rn | awk 'NR <= 30 { printf "%s %d, ", $2, $1 } END { print "" }'

awk '{ passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0
     }' $logs/sums | tee $logs/result
