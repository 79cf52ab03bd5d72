#!/bin/bash
# libjpeg_turbo_scale_eighths.sh - libjpeg-turbo 2.1.5 needs more time for a JPEG at 7/8 of its size than for all of it.
#
# The library decodes at M/8 of a picture's size, by an inverse transform of M x M values a block in place of 8 x 8. That is less
# work, but on x86-64 only the transforms of 8, 4 and 2 are vectorised: 7/8 takes 1.7 times as long as the whole picture, and 5/8
# still 1.3 times, though it has two fifths of the pixels. Without vectors (JSIMD_FORCENONE=1) 7/8 takes as long as the whole, and
# 5/8 less. A program that reduces photos is best served by half, a quarter or an eighth, and an average of its own after it.
set -euo pipefail

version=1:2.1.5-2
[ "$(uname -m)" = x86_64 ] || { echo "needs x86_64, not $(uname -m)"; exit 1; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
apt-get download -q "libjpeg-turbo-progs=$version" "libjpeg62-turbo=$version" "libturbojpeg0=$version" >/dev/null 2>&1
for package in ./*.deb; do dpkg -x "$package" root; done
export PATH="$scratch/root/usr/bin:$PATH" LD_LIBRARY_PATH="$scratch/root/usr/lib/x86_64-linux-gnu"

# 24 megapixels of faint noise on waves.
python3 - <<'PYTHON' | cjpeg -quality 60 -outfile photo.jpg
import math, random, sys
random.seed(1)
width, height = 6000, 4000
noise = [random.randrange(24) for _ in range(9973)]
tile = [bytes(int(90 + 60 * math.sin(x / 40 + row / 9) + noise[(x * 7 + row * 331) % 9973]) for x in range(3 * width)) for row in range(16)]
sys.stdout.buffer.write(b"P6 %d %d 255\n" % (width, height) + b"".join(tile[(y // 2) % 16] for y in range(height)))
PYTHON

seconds() { # M: the least user time of 9 runs, in ms
    local best=999999 taken
    for _ in 1 2 3 4 5 6 7 8 9; do
        taken=$( { TIMEFORMAT=%U; time djpeg -scale "$1/8" -outfile /dev/null photo.jpg; } 2>&1)
        taken=$((10#${taken/./}))
        if [ "$taken" -lt "$best" ]; then best=$taken; fi
    done
    echo "$best"
}
echo "libjpeg-turbo $version"
status=0
declare -A with without
for m in 8 7 6 5 4; do
    with[$m]=$(seconds $m)
    without[$m]=$(JSIMD_FORCENONE=1 seconds $m)
    echo "$m/8 of the size: ${with[$m]} ms with vectors, ${without[$m]} ms without"
done
above() { # M PERCENT: with vectors, M/8 takes more than so much of the whole
    [ $((100 * with[$1])) -gt $(($2 * with[8])) ] || { echo "expected: $1/8 takes over $2 % of 8/8"; status=1; }
}
below() { # M PERCENT: without them less
    [ $((100 * without[$1])) -lt $(($2 * without[8])) ] || { echo "expected: $1/8 takes below $2 % of 8/8 without vectors"; status=1; }
}
above 7 130
above 5 105
below 7 125
below 5 90
exit $status
