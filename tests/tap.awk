# tap.awk - the output of one cmocka program: a line of sums, then each failure and skip with its reason.
#
# Variables: name, status (of the program), seconds, limit, sums (a file that gets "passed failed skipped"), show (not
# 0: what passed tests say is printed too), none (1: a program may have no test of the names that were asked for).

function note(text) { notes = notes "    " text "\n" }

function said(i) {
    for (i = 1; i <= lines; i++) note("  " line[i])
    lines = 0
}

# What a test says comes before its result; cmocka's own reason, after "# ", behind it.
function keep(text) {
    if (lines < 60) line[++lines] = text
}

/^1\.\.[0-9]+$/ {
    planned += substr($0, 4)
    next
}

/^(not )?ok [0-9]+ (.* )?# SKIP/ {
    skipped++
    failing = 0
    reason = "no reason given"
    for (i = 1; i <= lines; i++)
        if (sub(/^skipped: /, "", line[i])) reason = line[i]
    sub(/.*# SKIP /, "")
    note("skipped " $0 ": " reason)
    lines = 0
    next
}

/^ok [0-9]+/ {
    passed++
    for (i = 1; show && i <= lines; i++) note(line[i])
    failing = lines = 0
    next
}

/^not ok [0-9]+/ {
    failed++
    failing = 1
    sub(/^not ok [0-9]+ (- )?/, "")
    note("FAILED " $0)
    said()
    next
}

# The group's own line.
/^# (not )?ok / {
    failing = 0
    next
}

failing && /^# / {
    note("  " substr($0, 3))
    next
}

{ keep($0) }

END {
    missing = planned - passed - failed - skipped
    if (status == 124 || status == 137) trouble = "timed out after " limit " s"
    else if (!planned && !none) trouble = "no result, exit status " status
    else if (missing > 0) trouble = "ended early, exit status " status
    else if (status && !failed) trouble = "exit status " status
    if (trouble) {
        note("FAILED " trouble)
        said()
        failed += missing > 0 ? missing : 1
    }
    printf "%-28s %d passed, %d failed, %d skipped%s\n%s", name, passed, failed, skipped,
           seconds ? " (" seconds " s)" : "", notes
    print passed + 0, failed + 0, skipped + 0 >>sums
}
