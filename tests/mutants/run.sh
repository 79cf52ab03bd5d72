#!/bin/sh
# run.sh [NAME...] - makes each wrong edit of tests/mutants/list in a copy of the tree and says which program of
# tests/check notices it; fails where none does, or where an edit's text is not found. Names: only these.
#
# --look     only says whether each edit's text is found
# MAKE, CC   as for the Makefile      JOBS  copies at a time, the processors' number if unset
set -u

cd "$(dirname "$0")/../.." || exit 1
unset MAKEFLAGS MFLAGS
here=tests/mutants/run.sh list=tests/mutants/list all=build/mutants
bin=build/native/tests/check

# The Nth edit's value of a key.
value() { # N KEY
    awk -v n="$1" -v key="$2" '
        $1 == "name" { at++ }
        at == n && $1 == key { sub(/^[a-z]+[ \t]*/, ""); sub(/[ \t]+$/, ""); print; exit }' $list
}

# The programs of a copy, but for test_levels: whole fits are slow, and notice little.
programs() { # FOLDER
    (cd "$1" && for test in tests/check/test_*.c; do
        [ "$test" = tests/check/test_levels.c ] || echo "$bin/$(basename "$test" .c)"
    done)
}

build() { # FOLDER JOBS PROGRAM...
    folder=$1 build_jobs=$2
    shift 2
    "${MAKE:-make}" --no-print-directory "-j$build_jobs" -C "$folder" TOOLCHAIN=native SAN= ${CC:+CC="$CC"} CFLAGS="-g0 -O1" WERROR= \
        O=build/native "$@" >"$folder/build.log" 2>&1
}

# Runs programs of a copy, up to the first that fails, whose name is left in FOLDER/failed.
run_tests() { # FOLDER PROGRAM...
    folder=$1
    shift
    : >"$folder/failed"
    (cd "$folder" && for program in "$@"; do
        SPLATFIT_QUICK=1 SPLATFIT_SEED='' timeout -k 5 120 "$program" >"$program.out" 2>&1 && continue
        basename "$program" >failed
        break
    done)
}

# Replaces the text; says what is wrong where it is not found as it must be.
edit() { # FROM TO AFTER OLD NEW
    AFTER=$3 OLD=$4 NEW=$5 awk '
        function count(text, part, n, at) {
            while ((at = index(text, part))) { n++; text = substr(text, at + length(part)) }
            return n + 0
        }
        { text = text $0 "\n" }
        END {
            after = ENVIRON["AFTER"]; old = ENVIRON["OLD"]
            found = count(text, after == "" ? old : after)
            if (old == "" || found != 1) {
                printf "\"%s\" is there %d times, not once\n", after == "" ? old : after, found > "/dev/stderr"
                exit 1
            }
            skip = after == "" ? 0 : index(text, after) + length(after) - 1
            at = index(substr(text, skip + 1), old)
            if (!at) {
                printf "\"%s\" is not behind \"%s\"\n", old, after > "/dev/stderr"
                exit 1
            }
            printf "%s%s%s", substr(text, 1, skip + at - 1), ENVIRON["NEW"], substr(text, skip + at + length(old))
        }' "$1" >"$2"
}

# One edit: its result is one line, "passed", "failed" or "skipped" first.
mutant() { # N
    name=$(value "$1" name) file=$(value "$1" file) dir=$all/$1
    case $file in
    arch/x86/*.h | arch/arm/*.h) level=$(basename "$file" .h) ;;
    *) level= ;;
    esac
    if [ -n "$level" ] && ! grep -q "^adam $level: [^n]" $all/sane/$bin/test_adam.out; then
        echo "skipped $name: $level is not on this machine"
        return
    fi
    rm -rf "$dir"
    cp -a $all/sane "$dir"
    if ! edit "$file" "$dir/edited" "$(value "$1" after)" "$(value "$1" old)" "$(value "$1" new)" 2>"$dir/edit.log"; then
        echo "failed  $name: $file: $(cat "$dir/edit.log")"
        return
    fi
    mv "$dir/edited" "$dir/$file"
    # Mostly the test of the edited file notices; the others are built only where it does not.
    own=$bin/test_$(basename "$file" .c)
    [ -x "$dir/$own" ] || own=
    others=$(programs "$dir" | grep -vxF "${own:-none}")
    for tests in "$own" "$others"; do
        [ -n "$tests" ] || continue
        # Names of programs are words.
        # shellcheck disable=SC2086
        if ! build "$dir" 1 $tests; then
            echo "failed  $name: does not compile: $dir/build.log"
            return
        fi
        # shellcheck disable=SC2086
        run_tests "$dir" $tests
        [ ! -s "$dir/failed" ] || break
    done
    if [ -s "$dir/failed" ]; then
        echo "passed  $name: caught by $(cat "$dir/failed")"
        rm -rf "$dir"
    else
        echo "failed  $name: SURVIVED ($file)"
    fi
}

if [ "${1:-}" = --one ]; then
    mutant "$2" | tee "$all/$2.result"
    exit 0
fi

if [ "${1:-}" = --look ]; then
    missing=0 n=0 count=$(grep -c '^name ' $list)
    while [ $n -lt "$count" ]; do
        n=$((n + 1))
        edit "$(value $n file)" /dev/null "$(value $n after)" "$(value $n old)" "$(value $n new)" && continue
        echo "$(value $n name): not found"
        missing=1
    done
    exit $missing
fi

for name in "$@"; do
    grep -qx "name *$name" $list || {
        echo "run.sh: no edit of $list is named $name" >&2
        exit 1
    }
done
rm -rf $all
mkdir -p $all/sane
tar cf - Makefile arch include src tests toolchains | tar xf - -C $all/sane
jobs=${JOBS:-$(nproc)}
tests=$(programs $all/sane)
# shellcheck disable=SC2086
if ! build $all/sane "$jobs" $tests; then
    cat $all/sane/build.log
    exit 1
fi
# shellcheck disable=SC2086
run_tests $all/sane $tests
if [ -s $all/sane/failed ]; then
    echo "failed  no edit: $(cat $all/sane/failed) fails without one"
    exit 1
fi
echo "passed  no edit: nothing fails"
echo "passed" >$all/sane.result

# Numbers of the edits that are asked for.
awk -v wanted=" $* " '$1 == "name" { n++; if (wanted ~ /^ *$/ || index(wanted, " " $2 " ")) print n }' $list |
    xargs -P "$jobs" -n 1 $here --one
cat $all/*.result | awk '
    { n[$1]++ }
    END {
        printf "%d passed, %d failed, %d skipped\n", n["passed"], n["failed"], n["skipped"]
        exit n["failed"] > 0
    }'
