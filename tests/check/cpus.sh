#!/bin/sh
# cpus.sh MACHINE "PROGRAM..." "OBJECT..." - runs the programs on older processors, emulated, at the level that splatfit
# chooses there by itself, looks through the objects for instructions beyond their level, and sums up.
#
# PROGRAM    splatfit
# QEMU_ROOT  where qemu finds the libraries of another machine: "-L DIR"
# OBJDUMP    the machine's objdump
set -u

here=$(dirname "$0")
machine=$1 programs=$2 objects=$3
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
qemu=qemu-$machine-static
unset SPLATFIT_ISA

# Processor and the level that it has; after the first comma what qemu warns that it does not emulate of it.
case $machine in
x86_64) cpus="core2duo:scalar Penryn:sse4 Nehalem:sse4
              Haswell-noTSX,-pcid,-x2apic,-tsc-deadline,-invpcid:avx2" ;;
# The Cortex-A9 has NEON, but not VFPv4. Of VFPv4 qemu refuses it the scalar part only; instructions.sh finds all.
arm) cpus="cortex-a9:scalar cortex-a7:neon cortex-a15:neon" ;;
aarch64) cpus="cortex-a53:neon" ;;
*) cpus= ;;
esac

result() { # "PASSED FAILED SKIPPED" TEXT [FILE]
    echo "-- $2"
    [ -z "${3:-}" ] || sed 's/^/    /' "$3"
    # shellcheck disable=SC2086
    printf '%s passed, %s failed, %s skipped\n' $1
}

# RUN and names of programs are words.
# shellcheck disable=SC2086
try_cpu() { # CPU LEVEL LOG
    name=${1%%,*} log=$3
    RUN="$qemu -cpu $1 ${QEMU_ROOT:-}"
    export RUN
    if ! "$qemu" -cpu help | grep -qw -- "$name"; then
        result "0 0 1" "$name: unknown to this qemu: skipped"
        return
    fi
    $RUN "$PROGRAM" info --cpu >"$log" 2>&1
    status=$?
    chosen=$(sed -n 's/ *in use.*//p' "$log")
    if grep -q "doesn't support requested feature.*$2" "$log"; then
        result "0 0 1" "$name: this qemu does not emulate $2: skipped"
        return
    fi
    if [ $status != 0 ] || [ "$chosen" != "$2" ]; then
        result "0 1 0" "FAILED $name: status $status, level \"$chosen\" instead of $2" "$log"
        return
    fi
    $RUN "$PROGRAM" fit 'sim:studio?width=48&height=32&frames=8' --steps 5 --max-gaussians 500 --quiet \
        -o "$log.ply" >"$log" 2>&1
    status=$?
    if [ $status = 0 ]; then
        result "1 0 0" "$name: $chosen"
    else
        result "0 1 0" "FAILED $name: $chosen: a fit ended with status $status" "$log"
    fi
    "$here/../run.sh" $programs
}

if ! command -v "$qemu" >/dev/null; then
    result "0 0 1" "$qemu is not installed: skipped" >"$scratch/0.out"
else
    jobs=0
    for cpu in $cpus; do
        jobs=$((jobs + 1))
        try_cpu "${cpu%:*}" "${cpu#*:}" "$scratch/$jobs" >"$scratch/$jobs.out" 2>&1 &
    done
    wait
fi

# shellcheck disable=SC2086
"$here/instructions.sh" "$machine" $objects >"$scratch/said" 2>&1
case $? in
0) result "1 0 0" "instructions: within their levels" ;;
77) result "0 0 1" "instructions: skipped" "$scratch/said" ;;
*) result "0 1 0" "FAILED instructions" "$scratch/said" ;;
esac >"$scratch/instructions.out"

cat "$scratch"/*.out | grep -vE '^[0-9]+ passed'
cat "$scratch"/*.out | awk '
    /^[0-9]+ passed/ { passed += $1; failed += $3; skipped += $5 }
    END {
        printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
        exit failed > 0 || passed == 0
    }'
