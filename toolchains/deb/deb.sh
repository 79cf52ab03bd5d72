#!/bin/bash
# deb.sh ARCH ROOT OUT - packages for Debian of what make builds for ARCH, into OUT: splatfit, libsplatfitN, libsplatfit-dev, and
# splatfit-mpi where MPI names one or two.
#
# ROOT is where the libraries are that it is linked with: the toolchain's root, or empty for this system. MAKE installs;
# NM names the tools; VERSION, SOVERSION and TRIPLE as in the Makefile. MAINTAINER goes into the packages.
set -euo pipefail

arch=$1 root=$2 out=$3
: "${VERSION:?}" "${SOVERSION:?}" "${TRIPLE:?}" "${PROGRAM:?}" "${NM:?}"
maintainer=${MAINTAINER:-The splatfit packagers <packages@splatfit.invalid>}
epoch=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH=$epoch
objdump=${NM%nm}objdump strip=${NM%nm}strip
here=$(dirname "$0")
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
umask 022

# The package of a library, by Debian's rule for their names; it must be where the library came from.
package_of() { # SONAME
    local name
    case $1 in
    libc.so.* | libm.so.* | ld-linux*) name=libc6 ;;
    libgcc_s.so.1) name=libgcc-s1 ;;
    libz.so.1) name=zlib1g ;;
    libmpi.so.* | libopen-rte.so.* | libopen-pal.so.*) name=libopenmpi3 ;;
    libcamera-base.so.*) name=libcamera${1#libcamera-base.so.} ;;
    *) name=$(sed -E 's/\.so\.([0-9.]+)$/\1/; s/([0-9])([0-9.]+)$/\1\2/' <<<"$1") ;;
    esac
    [ -d "$root/usr/share/doc/$name" ] || {
        echo "deb.sh: $1: no package $name in ${root:-/}" >&2
        return 1
    }
    echo "$name"
}
# The version that a package had when it was linked with, without Debian's own part.
version_of() { # PACKAGE
    local log=$root/usr/share/doc/$1/changelog.Debian.gz
    [ -e "$log" ] || log=$root/usr/share/doc/$1/changelog.gz
    { zcat "$log" 2>/dev/null || true; } | sed -nE '1s/.*\(([^)]*)\).*/\1/p' | sed -E 's/-[^-]*$//'
}
# The newest version of a family of symbols that a file asks for.
symbols_of() { # FILE FAMILY
    "$objdump" -T "$1" | grep -oE "$2_[0-9.]+" | sed "s/$2_//" | sort -Vu | tail -n 1
}
# What a file must find: the C library by its symbols, others at least as new as those that it was linked with.
depends_of() { # FILE
    local soname package version
    "$objdump" -p "$1" | sed -n 's/^ *NEEDED *//p' | while read -r soname; do
        [[ $soname != libsplatfit.so.* ]] || continue
        package=$(package_of "$soname") || exit 1
        case $package in
        libc6) version=$(symbols_of "$1" GLIBC) ;;
        *) version=$(version_of "$package") ;;
        esac
        echo "$package${version:+ (>= $version)}"
    done | sort -u | paste -sd, | sed 's/,/, /g'
}

# A folder of a package, with what each has.
begin_package() { # NAME
    local doc=$stage/$1/usr/share/doc/$1
    mkdir -p "$doc" "$stage/$1/DEBIAN"
    cp "$stage/copyright" "$doc/copyright"
    gzip -9n <"$stage/changelog" >"$doc/changelog.gz"
}
move() { # PACKAGE PATH...
    local package=$1 path
    shift
    for path in "$@"; do
        mkdir -p "$stage/$package/$(dirname "$path")"
        mv "$stage/all/$path" "$stage/$package/$path"
    done
}
end_package() { # NAME SECTION DEPENDS SUMMARY TEXT [FIELD...]
    local name=$1 section=$2 depends=$3 summary=$4 text=$5 tree=$stage/$1
    shift 5
    {
        printf 'Package: %s\nSource: splatfit\nVersion: %s\nArchitecture: %s\n' "$name" "$VERSION" "$arch"
        printf 'Maintainer: %s\nSection: %s\nPriority: optional\n' "$maintainer" "$section"
        printf 'Installed-Size: %s\n' "$(du -k -s --apparent-size "$tree" | cut -f 1)"
        [ -z "$depends" ] || printf 'Depends: %s\n' "$depends"
        [ $# = 0 ] || printf '%s\n' "$@"
        printf 'Description: %s\n%s\n' "$summary" "$(fold -s -w 76 <<<"$text" | sed 's/ *$//; s/^/ /')"
    } >"$tree/DEBIAN/control"
    (cd "$tree" && find usr -type f -print0 | sort -z | xargs -0 md5sum) >"$tree/DEBIAN/md5sums"
    find "$tree" -exec touch -h -d "@$epoch" {} +
    dpkg-deb --root-owner-group --build "$tree" "$out/${name}_${VERSION}_$arch.deb" >/dev/null
    echo "$out/${name}_${VERSION}_$arch.deb"
}

mkdir -p "$out"
lib=usr/lib/$TRIPLE
"${MAKE:-make}" --no-print-directory -s install DESTDIR="$stage/all" PREFIX=/usr LIBDIR="/$lib"
find "$stage/all/usr/share/man" -name '*.1' -exec gzip -9n {} +
"$strip" --strip-unneeded -R .comment -R .note "$stage/all/usr/bin/splatfit" "$stage/all/$lib/libsplatfit.so.$SOVERSION"
"$strip" --strip-debug "$stage/all/$lib/libsplatfit.a"
# What is linked, and how, is what the program itself says.
{
    cat "$here/copyright"
    printf 'Comment:\n'
    ${RUN:-} "$PROGRAM" --licences | sed 's/^$/./; s/^/ /'
} >"$stage/copyright"
printf 'splatfit (%s) unstable; urgency=medium\n\n  * This version.\n\n -- %s  %s\n' "$VERSION" "$maintainer" \
    "$(date -u -R -d "@$epoch")" >"$stage/changelog"

what="splatfit fits models of 3D Gaussians to photos with known cameras, and renders them, on ordinary and embedded processors."
library=libsplatfit$SOVERSION
rm -f "$out/splatfit-mpi_${VERSION}_$arch.deb"
if [ -n "${MPI:-}" ]; then
    begin_package splatfit-mpi
    needed=
    for kind in $MPI; do
        "$strip" --strip-unneeded -R .comment -R .note "$stage/all/usr/bin/splatfit-$kind"
        move splatfit-mpi "usr/bin/splatfit-$kind" "usr/share/man/man1/splatfit-$kind.1.gz"
        needed+="$(depends_of "$stage/splatfit-mpi/usr/bin/splatfit-$kind"), "
    done
    needed=$(sort -u <<<"${needed//, /$'\n'}" | sed '/^$/d' | paste -sd, | sed 's/,/, /g')
    recommends=${MPI/openmpi/openmpi-bin}
    end_package splatfit-mpi graphics "splatfit (= $VERSION), $needed" "fits 3D Gaussian scenes to pictures on several machines" \
        "$what These are programs whose fits run on several machines, over MPI." "Recommends: ${recommends// /, }"
fi
begin_package splatfit
move splatfit usr/bin/splatfit usr/share/man usr/share/bash-completion
end_package splatfit graphics "$(depends_of "$stage/splatfit/usr/bin/splatfit")" "fits 3D Gaussian scenes to pictures on CPUs" \
    "$what This is the program." 'Suggests: ffmpeg'

begin_package "$library"
move "$library" "$lib/libsplatfit.so.$SOVERSION"
echo "libsplatfit $SOVERSION $library (>= $VERSION)" >"$stage/$library/DEBIAN/shlibs"
echo "activate-noawait ldconfig" >"$stage/$library/DEBIAN/triggers"
needed=$(depends_of "$stage/$library/$lib/libsplatfit.so.$SOVERSION")
end_package "$library" libs "$needed" "fits 3D Gaussian scenes to pictures on CPUs (library)" \
    "$what This is the shared library." "Multi-Arch: same"

# What splatfit.pc requires of others is there with their -dev packages.
begin_package libsplatfit-dev
move libsplatfit-dev usr/include "$lib/pkgconfig" "$lib/libsplatfit.a" "$lib/libsplatfit.so"
others="libturbojpeg0-dev, libspng-dev, libjansson-dev, zlib1g-dev"
for module in apriltag libcamera libexif libwebp libzstd; do
    grep -q "^Requires.private:.* $module" "$stage/libsplatfit-dev/$lib/pkgconfig/splatfit.pc" && others="$others, ${module/#lib/lib}-dev"
done
others=${others/ apriltag-dev/ libapriltag-dev}
end_package libsplatfit-dev libdevel "$library (= $VERSION), $others" "fits 3D Gaussian scenes to pictures on CPUs (headers)" \
    "$what These are the headers and the static library." "Multi-Arch: same"
[ -z "$(find "$stage/all" -type f -o -type l)" ] || {
    echo "deb.sh: in no package:" >&2
    find "$stage/all" -type f >&2
    exit 1
}
