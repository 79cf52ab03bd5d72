# lines.awk - what gcov says of every object as text, line by line, summed up: a table by folder, and a page that lists each
# file's lines that nothing ran. Objects of one source (a kernel's levels) count as one: a line that one of them ran, ran.
#
# Variables: page (the file for the page), left_out (pairs "FILE reason;..." that do not count), least (percent). The exit status
# is 1 where the whole has less.

function html(text) {
    gsub(/&/, "\\&amp;", text)
    gsub(/</, "\\&lt;", text)
    return text
}

function percent(ran, all) { return all ? 100 * ran / all : 100 }

# Asks for nothing more than a whole number of the tenth below: 89.96 is not 90.
function shown(ran, all) { return sprintf("%.1f", int(10 * percent(ran, all)) / 10) }

function folder_of(file) {
    sub(/\/[^\/]*$/, "", file)
    return file
}

function row(name, ran, all) {
    return "<tr><td>" name "</td><td>" ran "</td><td>" all "</td><td>" shown(ran, all) "</td></tr>\n"
}

# Insertion sort of list[1..n].
function sort(list, n, i, k, held) {
    for (i = 2; i <= n; i++) {
        held = list[i]
        for (k = i - 1; k && list[k] > held; k--) list[k + 1] = list[k]
        list[k + 1] = held
    }
}

BEGIN {
    FS = ":"
    n = split(left_out, pairs, ";")
    for (i = 1; i <= n; i++) {
        at = index(pairs[i], " ")
        reason[substr(pairs[i], 1, at - 1)] = substr(pairs[i], at + 1)
    }
}

$2 + 0 == 0 {
    if ($3 == "Source") file = $4 ~ /^(src|arch)\// ? $4 : ""
    next
}

file == "" { next }

{
    count = $1
    line = $2 + 0
    gsub(/ /, "", count)
    if (count == "-") next
    if (!(file in last)) files[++file_count] = file
    if (line > last[file]) last[file] = line
    if (!((file, line) in ran)) {
        ran[file, line] = 0
        text = $0
        sub(/^[^:]*:[^:]*:/, "", text)
        source[file, line] = text
    }
    if (count !~ /^[#=]/) ran[file, line] = 1
}

END {
    sort(files, file_count)
    for (i = 1; i <= file_count; i++) {
        file = files[i]
        listed = ""
        for (line = 1; line <= last[file]; line++) {
            if (!((file, line) in ran)) continue
            total[file]++
            if (ran[file, line]) hit[file]++
            else listed = listed sprintf("%5d %s\n", line, html(source[file, line]))
        }
        if (file in reason) {
            apart = apart "<li>" file ": " reason[file] " (" hit[file] + 0 " of " total[file] " lines)</li>\n"
            said = said sprintf("left out: %s: %s\n", file, reason[file])
            continue
        }
        folder = folder_of(file)
        if (!(folder in folder_total)) folders[++folder_count] = folder
        folder_total[folder] += total[file]
        folder_hit[folder] += hit[file]
        rows = rows row(file, hit[file] + 0, total[file])
        if (listed != "")
            missed = missed "<details><summary>" file ": " total[file] - hit[file] " of " total[file] \
                " lines</summary>\n<pre>" listed "</pre></details>\n"
    }
    for (i = 1; i <= folder_count; i++) {
        folder = folders[i]
        all_total += folder_total[folder]
        all_hit += folder_hit[folder]
        by_folder = by_folder row(folder, folder_hit[folder], folder_total[folder])
        printf "%-16s %6d of %6d lines  %5s %%\n", folder, folder_hit[folder], folder_total[folder],
            shown(folder_hit[folder], folder_total[folder])
    }
    printf "%s%-16s %6d of %6d lines  %5s %%\n", said, "src and arch", all_hit, all_total, shown(all_hit, all_total)
    head = "<table>\n<tr><th>%s</th><th>run</th><th>lines</th><th>%%</th></tr>\n"
    printf "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<title>splatfit: lines that tests run</title>\n" \
        "<style>body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; } td { padding: 1px 8px; }\n" \
        "td + td { text-align: right; } pre { font-size: 12px; }</style>\n</head>\n<body>\n<h1>Lines that tests run</h1>\n" >page
    printf head "%s</table>\n<h2>Left out</h2>\n<ul>\n%s</ul>\n", "folder", by_folder row("all", all_hit, all_total), apart >page
    printf "<h2>Lines that nothing ran</h2>\n%s<h2>Files</h2>\n" head "%s</table>\n</body>\n</html>\n", missed, "file", rows >page
    exit percent(all_hit, all_total) < least
}
