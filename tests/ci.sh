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

# What a debugger alone reads takes a quarter of the compiler's time, and up to half of it for kernels.
export CFLAGS=-g1
# A file that was compiled before with these flags comes out of ccache's folder, which is empty at first. The programs of tests
# hold the library each; mold links one in an eighth of ld's time. What is installed, and all that the step fresh builds, ld links.
tools=$PWD/$logs/tools
mkdir -p $logs/linker "$tools"
if program=$(command -v mold); then
    ln -sfn "$program" $logs/linker/ld
    export TEST_LDFLAGS=-B$PWD/$logs/linker
fi
if program=$(command -v ccache); then
    for compiler in {,aarch64-linux-gnu-,arm-linux-gnueabihf-}{gcc,g++} clang clang++; do
        if command -v "$compiler" >/dev/null; then ln -sfn "$program" "$tools/$compiler"; fi
    done
    export PATH=$tools:$PATH CCACHE_DIR=$PWD/$logs/ccache
fi
# No two steps compile the same file with the same sanitizers: the first time, ccache only takes its part of clang's time, a tenth
# and more. Where an earlier run has left its folder, these files go there, too.
once=()
[ -d $logs/ccache ] || once=(CCACHE_DISABLE=1)

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

# Names of all tests but those given; as in TESTS, a name stands for all that begin with it: "cli" for cli_memory too.
all_but() { # NAME...
    local file name part
    for file in tests/{unit,golden,check,stability}/test_*.c; do
        name=${file##*/test_}
        name=${name%.c}
        for part in "$@"; do
            [[ $name == "$part" || $name == "$part"_* ]] && continue 2
        done
        echo "$name"
    done | sort -u | xargs
}

# Whole fits take minutes where they are emulated, and what reads formats is the same on both but for its integers: of these
# tests, each machine leaves out what the other runs, and both what has nothing of a machine: all allocations, all moments of a
# fit, the program's words, charts, figures of time, how good fits get.
both='allocations bench blur bundle cancel chart cli commands densify exposure features_allocations film fit_cache follow init live photos ranks reconstruct recovery refine schedule sfm sim_board sweep units validation'
only_64="calibrate capture first_map fit insert landmarks moving_average outputs stability studio $both"
only_32="archive checkpoint colmap context degrees features_limits inputs $both"
threaded='pool context scene render fit cancel pipe capture preview live'
debugged='render ply'
# The step address leaves these out, whose lines others run: the benchmark reads nothing of others and computes for long (the step
# bench runs it whole); test_live_loop plays a walk and searches for places on it, too.
not_sanitized='bench live_places'
# The steps of levels run these, and the programs of tests/check, at every level: where such a step follows, not before it, too.
at_levels='bin loss render golden'
# A test that was renamed must not fall out of these lists.
for name in $only_64 $only_32 $threaded $debugged $not_sanitized $at_levels; do
    compgen -G "tests/*/test_$name.c" >/dev/null || compgen -G "tests/*/test_${name}_*.c" >/dev/null || {
        echo "ci.sh: there is no test \"$name\"" >&2
        exit 1
    }
done
# A name of TESTS also stands for longer ones, so BUT says again what is left out: of "fit" and "fit_cache", the second.
emulated() { # NAME TOOLCHAIN TESTS-TO-LEAVE-OUT
    local run=("${quick[@]}" TIMEOUT=900 "${make[@]}" TOOLCHAIN="$2")
    # shellcheck disable=SC2086
    step "$1" "${run[@]}" TESTS="$(all_but $3 $at_levels)" BUT="$3 $at_levels" CHECK= test
    step "$1-levels" "${run[@]}" check
    step "$1-cpus" "${run[@]}" check-cpus
}

# clang builds all tests with sanitizers for memory and undefined behaviour; that for threads runs those whose code has threads.
group_threads() {
    step thread "${quick[@]}" "${once[@]}" TIMEOUT=900 SPLATFIT_EMULATED=1 "${make[@]}" SAN=thread TESTS="$threaded" test
}
group_addresses() {
    step address "${quick[@]}" "${once[@]}" "${make[@]}" CC=clang SAN=address,undefined BUT="$not_sanitized" test
    step mpi-address "${quick[@]}" "${once[@]}" "${make[@]}" CC=clang SAN=address,undefined MPI=mpich test-mpi
}
# As many targets at a time as there are processors. One level of kernels has the sanitizers and is used; the step address, whose
# test_hostile takes the same targets through all kept inputs, has them at every level.
group_fuzz() {
    local level=()
    [ "$(uname -m)" != x86_64 ] || level=(SPLATFIT_ISA=sse4 SAN_LEVELS=sse4)
    step fuzz env "${once[@]}" FUZZ_SECONDS=5 "${level[@]}" "${make[@]}" fuzz
}
group_armhf() {
    local -x CFLAGS=-g0
    emulated armhf arm-linux-gnueabihf "$only_64"
    step static-armhf "${make[@]}" TOOLCHAIN=arm-linux-gnueabihf STATIC=1 test-static
    step deb-armhf "${make[@]}" TOOLCHAIN=arm-linux-gnueabihf test-deb
}
# test-vm builds into the same folder, so it is in this group. The boards' toolchains differ in one flag: one file is enough.
group_aarch64() {
    local -x CFLAGS=-g0
    local board
    step vm env SPLATFIT_QUICK=1 "${make[@]}" test-vm
    emulated aarch64 aarch64-linux-gnu "$only_32"
    step deb-aarch64 "${make[@]}" TOOLCHAIN=aarch64-linux-gnu test-deb
    for board in rpi5 rpi4 rpi-zero2 jetson; do
        step board-$board "${make[@]}" TOOLCHAIN=$board build/$board/src/base/create_context.o
    done
}
# The README's commands on a bare system of Debian 13, with its compilers: the steps before it build and run everything with those
# of Debian 12. make test-fresh has nine systems. The tests and the demo are for that they compile and run there, the step gcc runs
# all tests and the step scenes holds the demo's fit to its quality.
group_fresh() {
    local -x SOME_TESTS='cli fit golden inputs ply render' NO_TESTS='cli_freeze cli_interrupted cli_live cli_refusals fit_cache'
    step fresh env SPLATFIT_QUICK=1 MAKEFLAGS_IN_ROOT="-j$(nproc)" COMPILERS=trixie DEMO_FLAGS='--steps 200' \
        "${make[@]}" test-fresh TESTS=trixie/bare
}
group_mutants() { step mutants "${make[@]}" mutants; }
# What is for who writes code.
group_debug() {
    local -x CFLAGS=
    step debug env "${once[@]}" "${make[@]}" DEBUG=1 TESTS="$debugged" test
    step commands "${make[@]}" compile_commands.json
}
group_static() { step static-native "${make[@]}" STATIC=1 test-static; }
# These and scenes use build/native, which the step gcc builds.
group_native() {
    step lint "${make[@]}" lint
    step levels "${make[@]}" check
    step cpus env TIMEOUT=900 "${make[@]}" check-cpus
    step install "${make[@]}" test-install
    # Only the files that see MPI are compiled for each.
    step mpi "${make[@]}" MPI="openmpi mpich" test-mpi
    step deb-native "${make[@]}" MPI="openmpi mpich" test-deb
    step outside "${make[@]}" test-outside
    step soak "${make[@]}" soak SECONDS=20
    step bench "${make[@]}" bench-quick
    step charts "${make[@]}" charts-quick
    step demo "${make[@]}" demo DEMO_FLAGS="--steps 20"
}
group_scenes() { step scenes env SPLATFIT_QUICK=1 TIMEOUT=1200 "${make[@]}" test-scenes; }

# Most steps keep little more than one CPU busy, so two workers take the groups in turn, the longest first: the short ones
# keep both busy to the end. A group's output is printed at its end. No two groups build in the same folder, except build/native,
# which is complete before its groups begin.
groups=(addresses aarch64 armhf native threads fuzz fresh mutants scenes debug static)
next() {
    flock $logs/taken.lock sh -c "echo >>$logs/taken; wc -l <$logs/taken"
}
work() {
    local n group
    while n=$(next) && [ "$n" -le ${#groups[@]} ]; do
        group=${groups[n - 1]}
        case $group in
        native | scenes) until [ -e $logs/built ]; do sleep 1; done ;;
        esac
        "group_$group" >"$logs/group-$group.out" 2>&1
        echo "$group" >>$logs/ended
        flock $logs/said.lock cat "$logs/group-$group.out"
    done
}
rm -f $logs/taken $logs/ended $logs/built
work &
other=$!
# Its scripts of tests/crash do what make crash does: kill.sh at more moments than it chooses itself, disk.sh at fewer calls.
step gcc env KILLS=25 EVERY=95 "${make[@]}" test
touch $logs/built
work
wait $other
# A worker that was killed never came to the end of its group.
for group in "${groups[@]}"; do
    if ! grep -qx "$group" $logs/ended; then
        cat "$logs/group-$group.out"
        echo "0 passed, 1 failed, 0 skipped" >>$logs/sums
        echo "== $group: ended before its last step"
    fi
done

# Where the time went: the steps, and each step's slowest programs.
echo "== seconds of $SECONDS: $(sort -rn $logs/times | awk '{ printf "%s %d, ", $2, $1 }')"
grep -HoE '^[a-z_0-9.]+ +[0-9]+ passed.*\([0-9]+ s\)' $logs/*.log | sed -E 's|.*/(.*)\.log:([^ ]+).*\(([0-9]+) s\)|\3 \1/\2|' |
    sort -rn | awk 'NR <= 30 { printf "%s %d, ", $2, $1 } END { print "" }'

awk '{ passed += $1; failed += $3; skipped += $5 }
     END {
         printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
         exit failed > 0
     }' $logs/sums | tee $logs/result
