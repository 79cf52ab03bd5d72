#!/bin/bash
# man.sh - every command has a page of the manual, with all that its help lists, and mandoc finds nothing wrong with it.
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"

pages=src/app/man
# shellcheck disable=SC2086 # RUN is a command and its arguments.
page() { "$pages/page.sh" "$1" ${RUN:-} "$program" >"$scratch/$1.1"; }

# As man shows it: without roff's marks, one word a line.
words() { sed -E 's/\\f[BIRP]//g; s/\\-/-/g; s/\\&//g; s/\\e/\\/g' "$1" | tr -s ' ,;()[]"' '\n'; }

whole() { # NAME COMMAND
    local file=$scratch/$1.1 option section
    page "$1" || return
    for section in NAME SYNOPSIS DESCRIPTION 'EXIT STATUS' EXAMPLES 'SEE ALSO'; do
        [ "$(grep -c "^\.SH $section\$" "$file")" = 1 ] || { echo "$1.1: not one section $section"; return 1; }
    done
    ! grep -n '@[A-Z]*@' "$file" || return 1
    [ -z "$2" ] || splatfit "$2" --help | sed -nE 's/^  (--[a-z0-9-]+).*/\1/p' | sort -u >"$scratch/options"
    [ -n "$2" ] || splatfit help --words | grep -v '^help' >"$scratch/options"
    [ "$(wc -l <"$scratch/options")" -ge 4 ] || { echo "$1: hardly an option"; return 1; }
    words "$file" | sed 's/^splatfit-//' >"$scratch/words"
    option=$(grep -vxFf "$scratch/words" "$scratch/options" | head -n 1)
    [ -z "$option" ] || { echo "$1.1: does not tell of $option"; return 1; }
}

clean() { # NAME: of what mandoc finds, but for a date that the build does not have
    mandoc -T lint -W warning "$scratch/$1.1" | grep -vE 'missing date|unknown manual|referenced manual not found' >"$scratch/said"
    [ ! -s "$scratch/said" ] || { cat "$scratch/said"; return 1; }
}

commands=$(splatfit help --words | grep -vE '^(--|help$)')
for command in '' $commands; do
    name=splatfit${command:+-$command}
    if [ ! -e "$pages/$name.man" ]; then
        check "$name.1" sh -c "echo '$pages/$name.man: is missing'; exit 1"
        continue
    fi
    check "$name.1 has its sections and every option" whole "$name" "$command"
    if command -v mandoc >/dev/null; then check "$name.1 is as mandoc wants it" clean "$name"; fi
done

# The programs that mpirun starts are made by the same tables: their pages are written by hand, and name the launcher of each.
of_mpi() { # KIND
    local file=$scratch/splatfit-$1.1 section
    "$pages/mpi.sh" "$1" "$(splatfit --version | sed 's/.* //')" >"$file" || return
    for section in NAME SYNOPSIS DESCRIPTION HOSTS LIMITS 'EXIT STATUS' EXAMPLES 'SEE ALSO'; do
        [ "$(grep -c "^\.SH $section\$" "$file")" = 1 ] || { echo "$file: not one section $section"; return 1; }
    done
    ! grep -n '@[A-Z_]*@' "$file" && [ "$(words "$file" | grep -c "^mpirun\.$1\$")" -ge 4 ] || return 1
    ! command -v mandoc >/dev/null || clean "splatfit-$1"
}
for kind in openmpi mpich; do check "splatfit-$kind.1 has its sections and names its launcher" of_mpi $kind; done

# The help, the page and a run agree about exit codes.
codes() {
    splatfit --help | sed -n '/^Exit codes:/,$s/^ *\([0-9][0-9]*\)  .*/\1/p' >"$scratch/help"
    sed -n '/^\.SH EXIT STATUS/,/^\.SH F/s/^\.B //p' "$scratch/splatfit.1" | grep -E '^[0-9]+$' >"$scratch/page"
    cmp "$scratch/help" "$scratch/page" && grep -qx 130 "$scratch/help" || return 1
    splatfit --version >/dev/null || return 1
    splatfit info "$scratch/nothing" 2>"$scratch/said"
    [ $? = 1 ] && grep -q "$scratch/nothing" "$scratch/said" || return 1
    splatfit fitt 2>"$scratch/said"
    [ $? = 2 ] && grep -q 'is fit meant' "$scratch/said" || return 1
    splatfit fit sim:studio --stepz 3 2>"$scratch/said"
    [ $? = 2 ] && grep -q 'is --steps meant' "$scratch/said"
}
check "exit codes" codes

licences() {
    splatfit --licences >"$scratch/licences" || return 1
    for library in libjpeg-turbo libspng zlib jansson glibc; do
        grep -A 1 "^  $library .*: " "$scratch/licences" | grep -q '  https://' || { echo "nothing of $library"; return 1; }
    done
}
check "licences of what is linked" licences
finish
