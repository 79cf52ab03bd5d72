#!/bin/sh
# includes.sh - every folder of src/ and arch/ includes only what lies before it, and no includes go in a circle.
#
#   kernels <- base <- scene <- {io, render};  base <- sim;  {io, sim} <- capture;  {io, sim, render} <- pose
#   base <- cluster <- render;  {io, render} <- fit;  pose <- sfm;  {sfm, fit} <- live
#   chart sees base;  bench sees base, kernels, scene, render, fit, arch and chart;  preview sees base, scene and io;
#   app sees bench, chart and preview;  arch sees kernels;  bench sees sfm, too;  all see include/splatfit
set -eu

arrows=$(mktemp)
trap 'rm -f "$arrows"' EXIT
bad=0

# Each line: a file, and a file that it includes.
# shellcheck disable=SC2016 # of awk's, not the shell's
find src arch -type f \( -name '*.[ch]' -o -name '*.cc' -o -name '*.hh' \) | sort | xargs awk '
    match($0, /^ *# *include *"[^"]*"/) {
        path = substr($0, 1, RLENGTH - 1)
        sub(/.*"/, "", path)
        path = FILENAME "/../" path
        while (sub(/[^\/]+\/\.\.\//, "", path)) {}
        print FILENAME, path
    }' >"$arrows"

# 1. The order. The module of a file: src/<module>/..., or arch for all of arch/.
awk '
    function allow(module, list) { allowed[module] = " " module " " list " " }
    function module_of(path, part) {
        split(path, part, "/")
        return part[1] == "src" ? part[2] : part[1]
    }
    BEGIN {
        allow("kernels", "")
        allow("base", "kernels")
        allow("scene", "base kernels")
        allow("io", "base kernels scene")
        allow("cluster", "base kernels")
        allow("render", "base kernels scene cluster")
        allow("sim", "base")
        allow("capture", "base kernels scene io sim")
        allow("pose", "base kernels scene io sim render")
        allow("sfm", "base kernels scene io pose")
        allow("fit", "base kernels scene io cluster render")
        allow("live", "base kernels scene io render pose sfm fit")
        allow("preview", "base scene io")
        allow("chart", "base")
        allow("bench", "base kernels scene render fit sfm arch chart")
        allow("app", "preview bench chart")
        allow("arch", "kernels")
    }
    $2 ~ /^include\/splatfit\// { next }
    {
        from = module_of($1)
        to = module_of($2)
        if (!(from in allowed)) {
            print $1 ": " from " is not a module that the order knows"
            bad = 1
        } else if (!index(allowed[from], " " to " ")) {
            print $1 ": " from " must not include " $2
            bad = 1
        }
    }
    END { exit bad }' "$arrows" || bad=1

# Reads lines "from to", fails where these go in a circle, and says each circle in a line.
no_circle() { # WHAT
    LC_ALL=C sort -u | LC_ALL=C tsort 2>&1 >/dev/null | awk -v what="$1" '
        function say() { if (line) print what line; line = "" }
        /input contains a loop/ { say(); bad = 1; next }
        { line = line " " $NF }
        END { say(); exit bad }'
}

# 2. No circle of folders, whatever the order above allows.
awk '
    function module_of(path, part) {
        split(path, part, "/")
        return part[1] == "src" ? part[2] : part[1]
    }
    $2 ~ /^(src|arch)\// { print module_of($1), module_of($2) }' "$arrows" |
    no_circle "folders include each other in a circle:" || bad=1

# 3. No circle of stems within a folder, subfolders included: x.c and x.h are one, what either includes is below it.
for folder in src/* arch; do
    sed 's/\.[a-z]*\( \|$\)/\1/g' "$arrows" | grep "^$folder/[^ ]* $folder/" |
        no_circle "stems include each other in a circle:" || bad=1
done
exit $bad
