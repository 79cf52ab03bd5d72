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
there=$(dpkg-query -W -f '${Version}' colmap 2>/dev/null || echo none)
if [ "$there" != "$version" ]; then
    echo "needs colmap $version, not $there: apt-get install colmap=$version ffmpeg libimage-exiftool-perl sqlite3"
    exit 1
fi
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

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
