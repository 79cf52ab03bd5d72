#!/bin/sh
# lint.sh - runs the checks beside it, each a script that exits 0, or 77 where it cannot be made here.
#
# QUICK=1: those that need no build and take seconds; format and scripts look only at files that differ from the last commit.
set -u

passed=0 failed=0 skipped=0
checks="includes lengths headers symbols abi comments links format words scripts makefiles mutants"
[ "${QUICK:-}" != 1 ] || checks="includes lengths comments links format words scripts makefiles mutants"
for check in $checks; do
    said=$("tests/lint/$check.sh" 2>&1)
    case $? in
    0) result=passed passed=$((passed + 1)) said= ;;
    77) result=skipped skipped=$((skipped + 1)) ;;
    *) result=FAILED failed=$((failed + 1)) ;;
    esac
    printf 'lint %-23s %s\n' "$check" $result
    [ -z "$said" ] || printf '%s\n' "$said" | sed 's/^/    /'
done
echo "$passed passed, $failed failed, $skipped skipped"
[ $failed = 0 ]
