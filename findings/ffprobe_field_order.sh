#!/bin/bash
# ffprobe_field_order.sh - ffprobe calls interlaced video progressive, or says nothing, while it flags each frame as interlaced.
#
# Of a stream ffprobe prints `field_order`, of a frame `interlaced_frame` and `top_field_first`. The stream's is what its container
# says or a parser finds. MP4 and QuickTime files of MPEG-4 part 2 that ffmpeg writes do not say it; in Matroska the same frames are
# "tt". HEVC codes interlaced video as single fields, each half as high as a
# frame: where an upper field is first, ffprobe's order is "progressive", and where a lower one is, "tt", which otherwise stands for
# the upper one. Of Motion JPEG, in turn, the container alone knows: no frame is flagged. A program that asks one of the two only
# leaves some videos combed.
set -euo pipefail

version=7:5.1.9-0+deb12u1
expected='MPEG-4 in .mp4, upper field first: stream unknown, frames 1,1 1,1 1,1 1,1
MPEG-4 in .mov, upper field first: stream unknown, frames 1,1 1,1 1,1 1,1
MPEG-4 in .mkv, upper field first: stream tt, frames 1,1 1,1 1,1 1,1
HEVC in .ts, upper field first: stream progressive, frames 1,1 1,0 1,1 1,0
HEVC in .ts, lower field first: stream tt, frames 1,0 1,1 1,0 1,1
Motion JPEG in .mkv, upper field first: stream tt, frames 0,0 0,0 0,0 0,0'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
# ffmpeg and all that it depends on: for an empty list of installed packages.
mkdir -p debs/partial && touch status
apt-get install -q -y -d --no-install-recommends -o Debug::NoLocking=1 -o Dir::State::status="$scratch/status" \
    -o Dir::Cache::archives="$scratch/debs" "ffmpeg=$version" >/dev/null 2>&1
for package in debs/*.deb; do dpkg -x "$package" root; done
libraries=root/usr/lib/$(uname -m)-linux-gnu
export PATH="$scratch/root/usr/bin:$PATH"
export LD_LIBRARY_PATH="$scratch/$libraries:$scratch/$libraries/blas:$scratch/$libraries/lapack:$scratch/$libraries/pulseaudio"

# Frames of two fields each, filmed one after the other, tff or bff; `filters` begin with a comma.
make_video() { # FILE ORDER FILTERS OPTIONS...
    local file=$1 order=$2 filters=$3
    shift 3
    ffmpeg -nostdin -v error -f lavfi -i "testsrc2=size=320x240:rate=50,interlace=scan=$order:lowpass=off$filters" -frames:v 50 \
        "$@" "$file"
}
say() { # WHAT FILE
    local order flags
    order=$(ffprobe -v error -select_streams v:0 -show_entries stream=field_order -of default=nw=1:nk=1 "$2" | head -n 1)
    flags=$(ffprobe -v error -select_streams v:0 -read_intervals '%+#12' -show_entries frame=interlaced_frame,top_field_first \
        -of default=nw=1:nk=1 "$2" | paste -d , - - | head -n 4 | xargs)
    echo "$1: stream $order, frames $flags"
}
x265=(-c:v libx265 -preset ultrafast -x265-params)
mpeg4=(-c:v mpeg4 -q:v 2 -flags +ilme+ildct -top 1)
make_video mpeg4.mp4 tff "" "${mpeg4[@]}"
make_video mpeg4.mov tff "" "${mpeg4[@]}"
make_video mpeg4.mkv tff "" "${mpeg4[@]}"
make_video upper.ts tff ,separatefields "${x265[@]}" log-level=none:interlace=tff
make_video lower.ts bff ,separatefields "${x265[@]}" log-level=none:interlace=bff
make_video jpegs.mkv tff "" -c:v mjpeg -pix_fmt yuvj420p -q:v 2 -field_order tt

seen=$(
    say "MPEG-4 in .mp4, upper field first" mpeg4.mp4
    say "MPEG-4 in .mov, upper field first" mpeg4.mov
    say "MPEG-4 in .mkv, upper field first" mpeg4.mkv
    say "HEVC in .ts, upper field first" upper.ts
    say "HEVC in .ts, lower field first" lower.ts
    say "Motion JPEG in .mkv, upper field first" jpegs.mkv
)
echo "ffmpeg $version"
echo "$seen"
[ "$seen" = "$expected" ] || { printf 'expected:\n%s\n' "$expected"; exit 1; }
