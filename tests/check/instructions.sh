#!/bin/sh
# instructions.sh MACHINE OBJECT... - no object or member of an archive holds an instruction beyond its level: that of
# its name, as in blend.avx2.o, or the baseline. Exits 77 for a machine without rules.
#
# OBJDUMP  the machine's objdump
set -u

machine=$1
shift
case $machine in
x86_64 | arm) ;;
aarch64) echo "NEON is aarch64's baseline" && exit 77 ;;
*) echo "no rules for $machine" && exit 77 ;;
esac

"${OBJDUMP:-objdump}" -d --no-show-raw-insn "$@" | awk -v machine="$machine" '
BEGIN {
    split(machine == "arm" ? "neon" : "sse4 avx2 avx512", names, " ")
    for (i in names) level[names[i]] = i + 0
    # What SSE3, SSSE3 and SSE4.1 brought, then SSE4.2 and POPCNT, which come with AVX2.
    sse4 = "^(addsubp[sd]|h(add|sub)p[sd]|lddqu|mov(sh|sl|d)dup|fisttp.*|pabs[bwd]|palignr|ph(add|sub)(w|d|sw)|" \
           "pmaddubsw|pmulhrsw|pshufb|psign[bwd]|blendv?p[sd]|dpp[sd]|extractps|insertps|movntdqa|mpsadbw|" \
           "packusdw|pblend(vb|w)|pcmpeqq|pextr[bdq]|pinsr[bdq]|p(max|min)(s[bd]|u[wd])|pmov[sz]x..|pmuldq|" \
           "pmulld|ptest|round[sp][sd]|phminposuw)$"
    sse42 = "^(pcmpgtq|pcmp[ei]str[im]|popcnt.?|crc32.?)$"
}

# The least level, by its number, that has an instruction: the first is the baseline.
function needs(mnemonic, operands) {
    if (machine == "arm")
        return mnemonic ~ /^(vfn?m[as]|v(ld|st)[1-4]\.|vdup|[su]div)/ || \
            mnemonic ~ /^v/ && operands ~ /(^|[^a-z0-9_])(q[0-9]+|d(1[6-9]|2[0-9]|3[01]))([^a-z0-9_]|$)/
    if (operands ~ /%zmm|%k[0-7]|%[xy]mm(1[6-9]|2[0-9]|3[01])/) return 3
    if (operands ~ /%ymm/ || (mnemonic ~ /^v/ && operands ~ /%xmm/) || mnemonic ~ sse42) return 2
    return mnemonic ~ sse4
}

/file format/ {
    object = $1
    sub(/:$/, "", object)
    parts = split(object, part, ".")
    name = part[parts - 1]
    sub(/_.*/, "", name) # what some processors add to a level
    has = level[name] + 0
    next
}

/^[0-9a-f]+ <.*>:$/ { symbol = $2 }

/^ +[0-9a-f]+:\t/ {
    split($0, field, "\t")
    split(field[2], word, " ")
    operands = field[2] "\t" field[3]
    sub(/[<#@].*/, "", operands)
    need = needs(word[1], operands)
    seen[need]++
    if (need > has && !told[object symbol]++) {
        print object ", " symbol " has an instruction of " names[need] ": " field[2] " " field[3]
        bad = 1
    }
}

END {
    # else the rules do not read this objdump
    for (i in names)
        if (!seen[i]) {
            print "no instruction of " names[i] " anywhere"
            bad = 1
        }
    exit bad
}'
