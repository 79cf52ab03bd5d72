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

# The programs of a tree, but for test_levels: whole fits are slow, and notice little.
programs() { # FOLDER
    (cd "$1" && for test in tests/check/test_*.c; do
        [ "$test" = tests/check/test_levels.c ] || echo "$bin/$(basename "$test" .c)"
    done)
}

# Makes the programs of the tree without edits, and notes the commands that did, one a line: a tree with an edit differs in few
# files, and make would take longer to find them than the compiler takes.
build() { # JOBS PROGRAM...
    build_jobs=$1
    shift
    "${MAKE:-make}" --no-print-directory "-j$build_jobs" -C $all/sane TOOLCHAIN=native SAN= ${CC:+CC="$CC"} CFLAGS="-g0 -O1" WERROR= \
        KERNELS_O=1 O=build/native V=1 "$@" >$all/sane/build.log 2>&1 || return 1
    sed -e ':again' -e '/\\$/{' -e N -e 's/\\\n//' -e 't again' -e '}' $all/sane/build.log | sed 's/ -MMD -MP / /' >$all/commands
}

# The object files of the tree without edits that hold a file, itself or by #include.
holds() { # FILE
    grep -rlF "/$(basename "$1")" $all/held | sort | while read -r deps; do
        # As the compiler names it: arch/vector/../scalar/exp2.h is arch/scalar/exp2.h.
        sed -e ':again' -e 's|[^/ .][^/ ]*/\.\./||' -e 't again' "$deps" | grep -oE '[^ \]+' | grep -qxF "$1" || continue
        deps=${deps#"$all/held/"}
        echo "${deps%d}o"
    done
}

# Compiles files of a copy again.
compile() { # FOLDER OBJECT...
    folder=$1
    shift
    for object in "$@"; do
        command=$(grep -F -- " -c -o $object " $all/commands) || return 1
        (cd "$folder" && rm -f "$object" && CCACHE_DISABLE=1 sh -c "$command") >>"$folder/build.log" 2>&1 || return 1
    done
}

# Links a program of a copy, with its changed objects of the library before the library, and runs it; status 0 where it fails.
notices() { # FOLDER PROGRAM OBJECT...
    folder=$1 program=$2
    shift 2
    objects=$(printf '%s\n' "$@" | grep -v '^build/native/tests/' | xargs)
    command=$(grep -F -- " -o $program " $all/commands | sed "s|build/native/libsplatfit.a|$objects &|") || return 1
    # A copy's files are those of the tree without edits until they are made anew.
    (cd "$folder" && rm -f "$program" && sh -c "$command") >>"$folder/build.log" 2>&1 || {
        echo "$program is not linked" >>"$folder/build.log"
        : >"$folder/broken"
        return 1
    }
    ! (cd "$folder" && SPLATFIT_QUICK=1 SPLATFIT_SEED='' timeout -k 5 120 "$program" >out 2>&1)
}

# Runs the programs of the tree without edits, up to the first that fails, whose name is left in $all/sane/failed.
run_tests() { # PROGRAM...
    : >$all/sane/failed
    (cd $all/sane && for program in "$@"; do
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
    # Hard links: whatever a copy changes it removes first.
    cp -al $all/sane "$dir"
    rm -f "$dir/build.log"
    if ! edit "$file" "$dir/edited" "$(value "$1" after)" "$(value "$1" old)" "$(value "$1" new)" 2>"$dir/edit.log"; then
        echo "failed  $name: $file: $(cat "$dir/edit.log")"
        return
    fi
    mv -f "$dir/edited" "$dir/$file"
    held=$(holds "$file")
    caught=$(catch "$dir" "$(basename "$file" .c)" "$held")
    if [ -e "$dir/broken" ]; then
        echo "failed  $name: does not compile: $dir/build.log"
    elif [ -n "$caught" ]; then
        echo "passed  $name: caught by $caught"
        rm -rf "$dir"
    else
        echo "failed  $name: SURVIVED ($file)"
    fi
}

# Makes a program with some changed objects of a copy. Status 0 ends the search: it notices, and its name is said, or something
# does not compile.
try() { # FOLDER PROGRAM OBJECT...
    copy=$1 program=$2
    shift 2
    compile "$copy" "$@" || : >"$copy/broken"
    [ ! -e "$copy/broken" ] || return 0
    notices "$copy" "$program" "$@" && basename "$program" && return 0
    [ -e "$copy/broken" ]
}

# Says which program notices the edit of a copy. Mostly it is the one that is named for a file that holds the edit, at the first of
# the levels that the file is compiled for; all levels and all programs are made only where that does not notice.
catch() { # FOLDER OWN OBJECTS
    tests=$(programs "$1" | grep -xF "$bin/test_$2"
        programs "$1" | grep -vxF "$bin/test_$2")
    for test in $tests; do
        kernel=${test##*/test_}
        some=$(
            echo "$3" | grep "/$kernel\.o\$"
            echo "$3" | grep "/$kernel\.[^/.]*\.o\$" | head -n 1
        )
        [ -n "$some" ] || continue
        # Names of files are words.
        # shellcheck disable=SC2086
        try "$1" "$test" $some && return
    done
    for test in $tests; do
        # shellcheck disable=SC2086
        try "$1" "$test" $3 && return
    done
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
if ! build "$jobs" $tests; then
    cat $all/sane/build.log
    exit 1
fi
# shellcheck disable=SC2086
run_tests $tests
if [ -s $all/sane/failed ]; then
    echo "failed  no edit: $(cat $all/sane/failed) fails without one"
    exit 1
fi
echo "passed  no edit: nothing fails"
# The library has what its object files hold: a copy without them is made in half the time.
mkdir -p $all/held
(cd $all/sane && find build/native -name '*.d' | tar cf - -T -) | tar xf - -C $all/held
find $all/sane/build/native -name '*.d' -delete
find $all/sane/build/native/src $all/sane/build/native/arch -name '*.o' -delete
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
