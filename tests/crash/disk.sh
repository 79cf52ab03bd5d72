#!/bin/bash
# disk.sh - the disk fills up at every call that needs it, in every command that writes: each file is as it was
# or as it should be, nothing half-written is left, and a line names the file and the reason. The same with a
# limit on the size of files. And memory ends at about a hundred allocations of each: no crash, nothing half-written left.
#
# EVERY             every n-th of the calls and of the hundred allocations fails in turn (29)
# SHIM              the library of shim.c; without: nothing can be tested
# SPLATFIT_PROGRAM  the program (build/splatfit)
set -u

every=${EVERY:-29}
if [ -z "${SHIM:-}" ]; then
    echo "skipped: emulated programs and sanitizers take no library before them"
    printf '1..1\nok 1 - disk # SKIP\n'
    exit
fi
program=$(realpath "${SPLATFIT_PROGRAM:-build/splatfit}") shim=$(realpath "$SHIM")
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM
cd "$scratch" || exit 1
scene='sim:studio?width=64&height=48&frames=9'

failures=0 what='' left=
fail() {
    echo "$what: $1"
    sed 's/^/    /' said
    failures=$((failures + 1))
}

# Times and speeds differ from run to run: only the end and the size of such a file are compared.
is_whole() { # FILE EXPECTED
    case $1 in
    *.json | *.svg | *.html) tail -c 2 "$1" | tr -d '\n' | grep -q '[]}>]$' ;;
    *.fit) [ "$(stat -c %s "$1")" = "$(stat -c %s "$2")" ] ;;
    *) cmp -s "$1" "$2" ;;
    esac
}

check_files() { # STATUS
    local file name
    left=$(find out -name '.*')
    [ -z "$left" ] || fail "left behind: $left"
    for file in $(cd expected && find . -type f); do
        name=${file#./}
        if [ -e "out/$name" ]; then
            if [ -e "old/$name" ] && cmp -s "out/$name" "old/$name"; then
                [ "$1" != 0 ] || cmp -s "old/$name" "expected/$name" || fail "$name was not written"
            else
                is_whole "out/$name" "expected/$name" || fail "$name is not whole"
            fi
        else
            [ "$1" != 0 ] || fail "$name is missing"
            [ ! -e "old/$name" ] || fail "$name is gone"
        fi
    done
}

check() { # REASON STATUS
    check_files "$2"
    case $2 in
    0) # a checkpoint is tried again
        if grep -qv 'c\.fit: ' said; then fail "it says something and ends well"; fi
        ;;
    1)
        [ -s said ] || fail "it says nothing"
        if grep -qvE "^splatfit [a-z]+: .*(out|expected).*: .*$1\$" said; then fail "not a line with file and reason"; fi
        [ -z "$(sort said | uniq -d)" ] || fail "says it twice"
        ;;
    *) fail "it ends with $2" ;;
    esac
}

start_over() {
    rm -rf out
    cp -r old out
}

# Any status but that of a crash; nothing half-written is left.
check_memory() { # STATUS
    [ "$1" -le 2 ] || fail "it ends with $1"
    [ "$1" = 0 ] || [ -s said ] || fail "it says nothing"
    left=$(find out -name '.*')
    [ -z "$left" ] || fail "left behind: $left"
}

# NAME COMMAND...: what it writes goes to out.
each_call() {
    local name=$1 calls=0 allocations=0 i mode
    shift
    what=$name
    start_over
    SHIM_COUNT=count LD_PRELOAD=$shim "$program" "$@" >/dev/null 2>said || fail "does not work"
    read -r calls allocations <count
    rm -rf expected
    cp -r out expected
    [ "$calls" -gt 3 ] || fail "the shim sees nothing"
    for ((i = 1; i <= calls; i += every)); do
        for mode in once on; do
            what="$name, call $i of $calls fails, mode $mode"
            start_over
            SHIM_DISK=$i SHIM_MODE=$mode LD_PRELOAD=$shim "$program" "$@" >/dev/null 2>said
            check "No space left on device" $?
        done
    done
    for i in 1 4 16; do
        what="$name, no file may be larger than $i KB"
        start_over
        (ulimit -f $i && exec "$program" "$@") >/dev/null 2>said
        check "File too large" $?
    done
    # libapriltag does not ask whether it got memory.
    [ "$name" != board ] || allocations=0
    for ((i = 1; i <= allocations; i += every * allocations / 100 + 1)); do
        what="$name, allocation $i of $allocations fails"
        start_over
        SHIM_MEMORY=$i LD_PRELOAD=$shim "$program" "$@" >/dev/null 2>said
        check_memory $?
    done
}

fit=(fit "$scene" --max-gaussians 100 --threads 2 --quiet)

mkdir old
: >said
"$program" "${fit[@]}" --steps 20 -o model.ply --log run.json || fail "the first fit fails"
"$program" "${fit[@]}" --steps 2 --seed 7 -o old/m.ply --checkpoint old/c.fit --log old/l.json --compare old/p.png ||
    fail "the old fit fails"
each_call fit "${fit[@]}" --steps 3 -o out/m.ply --checkpoint out/c.fit --checkpoint-every 0 --log out/l.json \
    --compare out/p.png
each_call prune prune model.ply "$scene" --loss 3 -o out/m.ply --log out/l.json --quiet
rm -rf old && mkdir old
cp model.ply old/m.spz
each_call convert convert model.ply out/m.spz --quiet
rm -rf old && mkdir old
each_call render render model.ply "$scene" --split test --out out --quiet
each_call chart chart run.json --out out --quiet
each_call board board -o out/b.svg
each_call capture capture "$scene" -o out/recording --format png --frames 3 --quiet
echo 1..1
if [ $failures = 0 ]; then echo "ok 1 - disk"; else echo "not ok 1 - disk"; fi
