#!/bin/bash
# colmap_cropped_exif_focal.sh - COLMAP 3.8 takes the focal length of a cropped photo for one that it knows, though it is wrong.
#
# EXIF has the focal length that would show as much on 35 mm film, and the width and height of the picture as the camera took it.
# Who crops a photo and keeps its EXIF changes the pixels alone. COLMAP divides the film's focal length by 35 and multiplies it by
# the longer side of the file, whatever EXIF says of the sides: of a photo cut to its middle half it takes half of the focal length
# in pixels, which the cut did not change, marks it as known (prior_focal_length 1), and starts its maps with it.
set -euo pipefail

version=3.8-1
expected=$'cropped 600x450: EXIF says 1200x900, focal length 445.7 px, known: 1\nwhole 1200x900: EXIF says 1200x900, focal length 891.4 px, known: 1'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
# All packages that these depend on: for an empty list of installed packages.
mkdir -p debs/partial && touch status
apt-get install -q -y -d --no-install-recommends -o Debug::NoLocking=1 -o Dir::State::status="$scratch/status" \
    -o Dir::Cache::archives="$scratch/debs" "colmap=$version" ffmpeg=7:5.1.9-0+deb12u1 libimage-exiftool-perl=12.57+dfsg-1 \
    sqlite3=3.40.1-2+deb12u2 >/dev/null 2>&1
for package in debs/*.deb; do dpkg -x "$package" root; done
libraries=$scratch/root/usr/lib/$(uname -m)-linux-gnu
export PATH="$scratch/root/usr/bin:$PATH" PERL5LIB="$scratch/root/usr/share/perl5" QT_PLUGIN_PATH="$libraries/qt5/plugins"
export LD_LIBRARY_PATH="$libraries:$libraries/blas:$libraries/lapack:$libraries/pulseaudio"

mkdir photos
ffmpeg -v error -f lavfi -i testsrc2=size=1200x900 -frames:v 1 -q:v 2 photos/whole.jpg
exiftool -q -overwrite_original -FocalLength=4.3 -FocalLengthIn35mmFormat=26 -ExifImageWidth=1200 -ExifImageHeight=900 photos/whole.jpg
ffmpeg -v error -i photos/whole.jpg -vf crop=600:450 -q:v 2 photos/cropped.jpg
exiftool -q -overwrite_original -TagsFromFile photos/whole.jpg -all:all photos/cropped.jpg

QT_QPA_PLATFORM=offscreen colmap feature_extractor --database_path db --image_path photos --SiftExtraction.use_gpu 0 >log 2>&1
seen=$(sqlite3 -separator ' ' db 'select i.name, c.width, c.height, c.prior_focal_length, hex(c.params)
                                  from images i join cameras c using (camera_id) order by i.name' |
    while read -r name width height known params; do
        # shellcheck disable=SC2001 # of each two digits
        focal=$(printf '%b' "$(sed 's/../\\x&/g' <<<"${params:0:16}")" | od -An -t f8)
        # shellcheck disable=SC2016 # exiftool's own
        printf '%s %dx%d: EXIF says %s, focal length %.1f px, known: %d\n' "${name%.jpg}" "$width" "$height" \
            "$(exiftool -s3 -p '${ExifImageWidth}x${ExifImageHeight}' "photos/$name")" "$focal" "$known"
    done)
echo "colmap $version"
echo "$seen"
[ "$seen" = "$expected" ] || { printf 'expected:\n%s\n' "$expected"; exit 1; }
