#!/bin/sh
# coverage.sh FOLDER OBJECTS - runs the tests, the bench and the charts of a build that counts lines, and says how much of src and
# arch ran: a table, and FOLDER/index.html with the lines that nothing ran. Less than LEAST percent fails.
#
# The tests of the kernels run all levels of this machine; those that it lacks are left out.
#
# GCOV     reads the counts
# LEAST    percent (90)
# LEVELS   of this family of machines
# MAKE     make, which builds and runs the tests
# PROGRAM  splatfit, so built
# TIMEOUT  seconds that one test program may take (1800): counting takes time
set -u

folder=$1 objects=$2
# Without a camera and its driver these do nothing. make test-vm runs them on an emulated board, whose counts stay there.
left_out='src/capture/v4l2_sys.c calls of the kernel on a camera;src/capture/libcamera.cc libcamera, which needs a camera'
mkdir -p "$folder" || exit 1
find "$objects" -name '*.gcda' -delete

failed=0
work() { # NAME COMMAND...
    name=$1
    shift
    if "$@" >"$folder/$name.log" 2>&1; then
        echo "$name: $(tail -n 1 "$folder/$name.log")"
    else
        echo "$name FAILED: $folder/$name.log"
        grep -A 12 FAILED "$folder/$name.log" | head -n 60
        failed=1
    fi
}
export TIMEOUT="${TIMEOUT:-1800}"
work tests "$MAKE" --no-print-directory COVERAGE=1 test
work bench "$PROGRAM" bench --quick --json "$folder/bench.json" --svg "$folder"
work charts tests/bench/charts.sh "$folder/charts" quick

set -- -name '*.gcno'
for level in $LEVELS; do
    SPLATFIT_ISA=$level "$PROGRAM" info --cpu >/dev/null 2>&1 && continue
    echo "left out: $level: not on this machine"
    set -- "$@" ! -name "*.$level.gcno"
done
find "$objects/src" "$objects/arch" "$@" -print0 | xargs -0 "$GCOV" -t 2>/dev/null |
    awk -v page="$folder/index.html" -v left_out="$left_out" -v least="${LEAST:-90}" -f tests/coverage/lines.awk || {
    echo "less than ${LEAST:-90} %"
    failed=1
}
echo "$folder/index.html: the lines that nothing ran"
[ $failed = 0 ]
