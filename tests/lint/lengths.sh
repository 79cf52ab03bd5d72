#!/bin/sh
# lengths.sh - no file is longer than 500 lines, no function longer than 60, no parameter list longer than 7.
#
# Of src/, include/ and tests/; the kernels of arch/ are as long as they must be. A function begins with its name's line at the
# left margin and ends with the next } there, as clang-format lays it out; comments and what is quoted count as lines, not as
# code.
set -eu

# shellcheck disable=SC2016 # of awk's, not the shell's
find src include tests -type f \( -name '*.[ch]' -o -name '*.cc' -o -name '*.hh' \) | sort | xargs awk '
    # The line without strings and comments; `inside` is kept from line to line.
    function code_of(line, out, at, rest) {
        out = ""
        gsub(/\\./, "", line)
        while (line != "") {
            if (inside) {
                at = index(line, "*/")
                if (!at) return out
                line = substr(line, at + 2)
                inside = 0
            } else if (match(line, /"[^"]*"|\x27[^\x27]*\x27|\/\*|\/\//)) {
                out = out substr(line, 1, RSTART - 1)
                rest = substr(line, RSTART, RLENGTH)
                line = substr(line, RSTART + RLENGTH)
                if (rest == "//") return out
                if (rest == "/*") inside = 1
                else out = out "0"
            } else {
                out = out line
                line = ""
            }
        }
        return out
    }
    # The parameters of the head of a function: the commas of its first parentheses, less those of inner ones.
    function parameters(head, i, c, depth, n) {
        n = 1
        for (i = index(head, "("); i && i <= length(head); i++) {
            c = substr(head, i, 1)
            if (c == "(" || c == "[") depth++
            if ((c == ")" || c == "]") && --depth == 0) break
            if (c == "," && depth == 1) n++
        }
        return n
    }
    function fail(where, what) {
        print where ": " what
        bad = 1
    }
    function end_of_file() {
        if (file != "" && lines > 500) fail(file, lines " lines are more than 500")
    }
    FNR == 1 { end_of_file(); file = FILENAME; inside = 0; head = ""; from = 0 }
    { lines = FNR; line = code_of($0) }
    # In a function, up to the } at the margin.
    from {
        if (line ~ /^}/) {
            if (FNR - from + 1 > 60) fail(file ":" from, "a function of " FNR - from + 1 " lines: more than 60")
            from = 0
        }
        next
    }
    # At the margin a head begins, which goes on until { or ;.
    line ~ /^[A-Za-z_]/ { head = ""; begun = FNR }
    line ~ /^[A-Za-z_]/ || head != "" {
        head = head line
        if (head ~ /[{;]/) {
            if (head ~ /^[A-Za-z_][A-Za-z0-9_:& *]*\(/ && head !~ /^(typedef|struct|enum)[^(]*{/) {
                if (parameters(head) > 7) fail(file ":" begun, parameters(head) " parameters are more than 7")
                if (head ~ /\{$/) from = begun
            }
            head = ""
        }
    }
    END { end_of_file(); exit bad }'
