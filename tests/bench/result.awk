# result.awk - numbers of a fit's result, in the order of `fields`, from the log that fit --log writes; of the result itself,
# not of its views, which lie deeper.
BEGIN { n = split(fields, wanted, " ") }
/^ "result"/ { inside = 1 }
/^  "/ && inside {
    split($0, part, /[":,]+/)
    if (!(part[2] in value)) value[part[2]] = part[3] + 0
}
END { for (i = 1; i <= n; i++) printf "%s%s", value[wanted[i]], i < n ? " " : "\n" }
