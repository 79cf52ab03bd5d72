#!/bin/sh
# symbols.sh - what LIB and SO define: the interface, names that begin with sf_, no variable data. No folder calls up.
set -eu

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
bad=0
report() { # PREFIX FILE: says each line of FILE
    [ -s "$2" ] || return 0
    sed "s|^|$1 |" "$2"
    bad=1
}

grep -hv '^#define' include/splatfit/*.h | tr '\n' ' ' | grep -o 'SF_API [^(;]*(' |
    sed 's/.*[ *]\(sf_[a-z0-9_]*\)($/\1/' | sort >"$scratch/declared"
"${NM:-nm}" -D --defined-only --without-symbol-versions "$SO" | awk '$2 != "A" { print $3 }' | sort >"$scratch/exported"
comm -13 "$scratch/declared" "$scratch/exported" >"$scratch/undeclared"
comm -23 "$scratch/declared" "$scratch/exported" >"$scratch/undefined"
report "$SO exports, but no public header declares," "$scratch/undeclared"
report "$SO does not define" "$scratch/undefined"

# The one C++ file holds what it uses of the C++ library's templates.
"${NM:-nm}" -g --defined-only "$LIB" |
    awk 'NF == 3 && $3 !~ /^(sf_|_Z(Z?N[KO]*St|N9__gnu_cxx|N[KO]*9libcamera|T[ISV]|GV|St)|DW\.ref\.)/ { print $3 }' >"$scratch/foreign"
report "$LIB defines a global that does not begin with sf_:" "$scratch/foreign"

# The library has no globals that change. Tables of pointers are relocated once and read-only after that.
objdump -t "$LIB" | awk '
    / O / && /[ \t]([*]COM[*]|\.t?(data|bss)[^ \t]*)[ \t]/ && !/\.data\.rel\.ro|DW\.ref\./ { print $NF }
' >"$scratch/data"
report "$LIB holds a variable of static duration:" "$scratch/data"

# Folders call each other in no circle, also where a public header hides that from the includes.
tr ' ' '\n' <"$(dirname "$LIB")/sources" | grep -E '/src/.*\.o$' | grep -vE '/src/(app|bench|chart|preview)/' |
    xargs "${NM:-nm}" -A -g | awk '
        { folder = $1; sub(/.*\/src\//, "", folder); sub(/\/.*/, "", folder) }
        / [BDRT] / { home[$NF] = folder }
        $(NF - 1) == "U" { calls[folder " " $NF] }
        END { for (c in calls) if (split(c, p, " ") && p[2] in home && home[p[2]] != p[1]) print p[1], home[p[2]] }' |
    LC_ALL=C sort -u | tsort 2>&1 >/dev/null | sed 's/^tsort: //' >"$scratch/circle"
report "$LIB: folders that call each other:" "$scratch/circle"
exit $bad
