#!/bin/sh
# page.sh PAGE - the page at PAGE, with the style and the scripts that it names put into it, as an array of C.
set -eu

folder=$(dirname "$1")
cat <<END
#include "preview/serve.h"

const unsigned char sf_preview_page[] = {
END
awk -v folder="$folder" '
    # Puts the file that the line names between two tags.
    function put(tag, name,    line, lines) {
        print "<" tag ">"
        while ((getline line <(folder "/" name)) > 0) {
            print line
            lines++
        }
        if (!lines) {
            print folder "/" name ": cannot be read" >"/dev/stderr"
            exit 1
        }
        print "</" tag ">"
    }
    /^<link rel="stylesheet" href="[a-z_]*[.]css">$/ { split($0, part, "\""); put("style", part[4]); next }
    /^<script src="[a-z_]*[.]js"><\/script>$/ { split($0, part, "\""); put("script", part[2]); next }
    { print }' "$1" | od -An -v -tx1 | sed 's/ \([0-9a-f][0-9a-f]\)/0x\1,/g'
cat <<END
};
const size_t sf_preview_page_size = sizeof sf_preview_page;
END
