# compile_commands.awk - what make prints of how files are compiled, as clang's tools read it: compile_commands.json.
#
# -v folder=DIR is where make runs. A line that compiles ends with "-c -o OBJECT FILE".
function quoted(text) {
    gsub(/\\/, "\\\\", text)
    gsub(/"/, "\\\"", text)
    return "\"" text "\""
}
BEGIN { printf "[" }
$(NF - 3) == "-c" && $(NF - 2) == "-o" {
    printf "%s\n{\"directory\": %s, \"file\": %s, \"output\": %s, \"command\": %s}", n++ ? "," : "", quoted(folder), quoted($NF), quoted($(NF - 1)),
        quoted($0)
}
END {
    print "\n]"
    exit !n
}
