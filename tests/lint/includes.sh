#!/bin/sh
# includes.sh - every module of src/ and arch/ includes only what lies before it.
#
#   kernels <- base <- scene <- {io, render};  base <- sim;  {io, sim} <- capture;  {io, sim, render} <- pose
#   {io, render} <- fit;  {pose, fit} <- live
#   chart sees base;  bench sees base, kernels, scene, render, fit, arch and chart;  preview sees base, scene and io;
#   app sees bench, chart and preview;  arch sees kernels;  all see include/splatfit
set -eu

# The module of a file: src/<module>/..., or arch for all of arch/.
find src arch -type f \( -name '*.[ch]' -o -name '*.cc' -o -name '*.hh' \) | sort | while read -r file; do
    sed -n 's/^ *# *include *"\([^"]*\)".*/\1/p' "$file" | while read -r name; do
        echo "$file $(realpath -m --relative-to=. "$(dirname "$file")/$name")"
    done
done | awk '
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
        allow("render", "base kernels scene")
        allow("sim", "base")
        allow("capture", "base kernels scene io sim")
        allow("pose", "base kernels scene io sim render")
        allow("fit", "base kernels scene io render")
        allow("live", "base kernels scene io render pose fit")
        allow("preview", "base scene io")
        allow("chart", "base")
        allow("bench", "base kernels scene render fit arch chart")
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
    END { exit bad }'
