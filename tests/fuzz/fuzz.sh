#!/bin/bash
# fuzz.sh - runs each target under libFuzzer for a while, from the inputs that are kept and those of runs before.
#
# FUZZ_SECONDS  of each target, 20 if unset        FUZZ_JOBS  targets at a time, one a processor if unset
# TARGETS       only these
#
# What grows is kept in build/fuzz/corpus, what was found in build/fuzz/found: see tests/fuzz/README.md.
set -uo pipefail

cd "$(dirname "$0")/../.." || exit 1
seconds=${FUZZ_SECONDS:-20}
out=build/fuzz
logs=$out/logs
mkdir -p $logs $out/corpus $out/found

summary() { echo "$1 passed, $2 failed, $3 skipped"; }
skip() { # WHY
    echo "fuzz: skipped: $1"
    summary 0 0 1
    exit 0
}
command -v clang >/dev/null || skip "there is no clang"
echo 'int LLVMFuzzerTestOneInput(void); int LLVMFuzzerTestOneInput(void) { return 0; }' |
    clang -fsanitize=fuzzer,address,undefined -x c - -o $out/works 2>$logs/works ||
    skip "this clang has no libFuzzer"

config=(CC=clang 'SAN=fuzzer-no-link,address,undefined')
"${MAKE:-make}" --no-print-directory "${config[@]}" fuzz-program || {
    summary 0 1 0
    exit 1
}
program=${FUZZ_PROGRAM:-build/native-clang-fuzzer-no-link-address-undefined/tests/fuzz/libfuzzer}
rm -rf $out/seeds
"$program" --seeds=$out/seeds || {
    summary 0 1 0
    exit 1
}

run_target() { # NAME
    local name=$1 log=$logs/$1.log folders=("$out/corpus/$1") dictionary=()
    mkdir -p "$out/corpus/$name" "$out/found/$name"
    for folder in $out/seeds tests/fuzz/corpus tests/fuzz/found; do
        [ -d "$folder/$name" ] && folders+=("$folder/$name")
    done
    [ -f "tests/fuzz/$name.dict" ] && dictionary=("-dict=tests/fuzz/$name.dict")
    # Slow, large and greedy inputs are findings too.
    "$program" --target="$name" "${dictionary[@]}" -max_total_time="$seconds" -timeout=5 -rss_limit_mb=512 \
        -malloc_limit_mb=256 -max_len=32768 -print_final_stats=1 -close_fd_mask=1 \
        -artifact_prefix="$out/found/$name/" "${folders[@]}" >"$log" 2>&1
    echo $? >"$logs/$name.status"
}
export -f run_target
export out logs seconds program

read -ra targets <<<"${TARGETS:-$("$program" --targets | xargs)}"
# What was given back stays with AddressSanitizer for a while: 256 MB of it would leave half of what a target may take.
ASAN_OPTIONS=allocator_may_return_null=0:handle_abort=1:detect_leaks=1:quarantine_size_mb=32 UBSAN_OPTIONS=print_stacktrace=1 \
    TMPDIR=$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}") \
    xargs -P "${FUZZ_JOBS:-$(nproc)}" -I{} bash -c 'run_target {}' < <(printf '%s\n' "${targets[@]}")

passed=0 failed=0
for name in "${targets[@]}"; do
    log=$logs/$name.log
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    covered=$(grep -oE 'cov: [0-9]+' "$log" | tail -n 1)
    result=passed
    if [ "$(cat "$logs/$name.status")" = 0 ]; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        result=FAILED
    fi
    printf '%-7s %-12s %9s executions, %s\n' "$result" "$name" "${runs:-0}" "${covered:-cov: 0}"
    if [ $result = FAILED ]; then
        # What a target itself found wrong is the line before the sanitizer's.
        grep -E -B1 '^==[0-9]+== ?ERROR|^SUMMARY|^artifact_prefix|runtime error|Test unit written' "$log" |
            grep -vE '^(#|--|    #)' | sed 's/^/    /'
    fi
done
summary $passed $failed 0
[ $failed = 0 ]
