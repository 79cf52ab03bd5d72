#!/bin/bash
# fresh.sh [SUITE/START...] - the README's two commands, as written, on fresh Debian systems: each first go, without a warning,
# and with the same parts built in.
#
# Each system is a separate root, made by debootstrap; roots share downloaded packages and nothing else. SUITE is bookworm,
# trixie or sid. START is what is there before the commands:
#   bare      minbase with git, make and gcc
#   desktop   that with g++ and pkg-config
#   user      build-essential and git, and a user without root and sudo; the line that the command prints is typed as root
# CACHE is where packages and roots are kept; MIRROR another mirror than this system's; COMPILERS names
# the suites whose clang builds too, with warnings as errors; SOME_TESTS the tests that are enough, but for NO_TESTS; DEMO_FLAGS
# is passed on to make demo. Needs root.
set -euo pipefail

cd "$(dirname "$0")/../.."
cache=${CACHE:-$HOME/.cache/splatfit}/fresh
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
# shellcheck disable=SC2016 # apt-get expands it
MIRROR=${MIRROR:-$(apt-get indextargets --format '$(SITE)' 'Origin: Debian' 2>/dev/null | head -n 1)}
MIRROR=${MIRROR:-http://deb.debian.org/debian}
[ $# != 0 ] || set -- {bookworm,trixie,sid}/{bare,desktop,user}
[ "$(id -u)" = 0 ] || { echo "fresh.sh: needs root, to make roots of Debian" >&2; exit 1; }

work=$cache/roots
mkdir -p "$work/mount"
if ! mount -t proc proc "$work/mount" 2>/dev/null; then
    echo "SKIPPED all: this system does not let root mount, as roots of Debian need it"
    echo "0 passed, 0 failed, $# skipped"
    exit
fi
umount "$work/mount"
unmount() { # ROOT
    local at
    for at in proc dev var/cache/apt/archives; do
        if mountpoint -q "$1/$at"; then umount -l "$1/$at"; fi
    done
}
remove() { # ROOT
    [ -d "$1" ] || return 0
    unmount "$1"
    rm -rf --one-file-system "$1"
}

in_root() { # COMMAND...: as root, or as $as
    chroot ${as:+--userspec="$as:$as"} "$root" /usr/bin/env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        HOME="${as:+/home/}${as:-/root}" LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive ${SPLATFIT_QUICK:+SPLATFIT_QUICK=1} \
        MAKEFLAGS="${MAKEFLAGS_IN_ROOT:-} -- ${variables[*]// /\\ }" "$@"
}

serves() { # SUITE
    curl -sfIo /dev/null "$MIRROR/dists/$1/InRelease" || wget -q --spider "$MIRROR/dists/$1/InRelease"
}

# A bare root of the suite, kept for the others of this run.
make_base() { # SUITE
    base=$work/$1-base
    [ ! -e "$base/done" ] || return 0
    remove "$base"
    mkdir -p "$cache/debs-$1"
    debootstrap --variant=minbase --keyring="$keyring" --cache-dir="$cache/debs-$1" "$1" "$base" "$MIRROR" >"$base.log" 2>&1 || {
        tail -n 3 "$base.log"
        return 1
    }
    echo force-unsafe-io >"$base/etc/dpkg/dpkg.cfg.d/fresh"
    cp /etc/resolv.conf /etc/hosts "$base/etc/"
    touch "$base/done"
}

make_root() { # SUITE START
    root=$work/$1-$2
    remove "$root"
    cp -a "$base" "$root"
    mount -t proc proc "$root/proc"
    mount --bind /dev "$root/dev"
    mkdir -p "$cache/debs-$1/partial"
    mount --bind "$cache/debs-$1" "$root/var/cache/apt/archives"
    # Downloaded packages are for the next root too. A mirror that is a snapshot says that it is out of date.
    printf '%s;\n' 'Binary::apt::APT::Keep-Downloaded-Packages "1"' 'APT::Keep-Downloaded-Packages "1"' \
        'APT::Sandbox::User "root"' 'Acquire::Check-Valid-Until "false"' >"$root/etc/apt/apt.conf.d/fresh"
    case $2 in
    bare) packages="git make gcc" ;;
    desktop) packages="git make gcc g++ pkg-config" ;;
    user) packages="git build-essential" ;;
    esac
    # shellcheck disable=SC2086
    { in_root apt-get update -qq && in_root apt-get install -qq -y --no-install-recommends ca-certificates $packages; } \
        >"$root.packages.log" 2>&1 || { tail -n 3 "$root.packages.log"; return 1; }
    git clone -q --bare . "$root/srv/splatfit"
    home=/root
    as=
    if [ "$2" = user ]; then
        in_root useradd -m -s /bin/bash user
        as=user home=/home/user
        chown -R --reference="$root$home" "$root/srv/splatfit"
    fi
}

# The README's commands. A user's first one may stop with the line to be typed as root, once.
readme() { # START
    local tree=$home/splatfit line
    in_root git clone -q /srv/splatfit "$tree"
    for command in "make demo" "make test"; do
        grep -q "^    $command" README.md || { echo "README.md: does not say \"$command\""; return 1; }
        if ! in_root sh -c "cd $tree && $command"; then
            line=$(sed -n 's/^install them with: sudo //p' "$log" | tail -n 1)
            if [ "$1 $command" != "user make demo" ] || [ -z "$line" ]; then
                echo "$command: failed"
                return 1
            fi
            (as='' && printf 'y\n' >"$root/tmp/yes" && in_root sh -c "$line" <"$root/tmp/yes") || { echo "$line: failed"; return 1; }
            in_root sh -c "cd $tree && $command" || { echo "$command: failed after what it asked for was installed"; return 1; }
        fi
    done
    if ! [ -s "$root$tree/build/demo.ply" ] || ! [ -s "$root$tree/build/demo.png" ]; then
        echo "make demo: left no model"
        return 1
    fi
}

# The newest clang of the root, where this is asked for; what gcc warns of has been seen.
compilers() {
    local tree=$home/splatfit
    [[ " ${COMPILERS:-} " == *" $suite "* ]] || return 0
    (as='' && in_root apt-get install -qq -y --no-install-recommends clang) || return 1
    in_root sh -c "cd $tree && make WERROR=1 CC=clang CFLAGS=-O0 KERNELS_O=0"
}

# What info --build says, without versions: the same in all roots, and nothing left out but MPI, which only programs of
# their own have.
check_parts() {
    in_root "$home/splatfit/build/splatfit" info --build | sed '1d; /^ompi-c /d; /^mpich /d; s/^\([^ ]* *\)[0-9][^:]*:/\1built in:/' >"$root.parts"
    if grep 'not built in' "$root.parts"; then return 1; fi
    [ -e "$work/parts" ] || cp "$root.parts" "$work/parts"
    diff "$work/parts" "$root.parts"
}

# What make is told beside the README's words.
variables=(${SOME_TESTS:+"TESTS=$SOME_TESTS"} ${NO_TESTS:+"BUT=$NO_TESTS"} ${DEMO_FLAGS:+"DEMO_FLAGS=$DEMO_FLAGS"})
passed=0 failed=0 skipped=0
one() { # SUITE/START
    suite=${1%/*} start=${1#*/} began=$SECONDS as='' result=
    log=$work/$suite-$start.log
    if [ "$suite" = sid ] && ! serves sid; then
        echo "skipped $1: the mirror does not serve it"
        skipped=$((skipped + 1))
        return
    fi
    if ! make_base "$suite"; then
        echo "FAILED  $1: debootstrap"
        failed=$((failed + 1))
        return
    fi
    if ! make_root "$suite" "$start"; then
        result="its packages cannot be installed"
    elif ! readme "$start" >"$log" 2>&1 || ! compilers >>"$log" 2>&1; then
        result=$(tail -n 20 "$log")
    elif grep -n 'warning:' "$log"; then
        result="a warning"
    elif ! result=$(check_parts); then
        result=${result:-parts differ}
    fi
    local size=$(($(du -sxk "$root" | cut -f1) / 1024))
    unmount "$root"
    if [ -n "$result" ]; then
        echo "FAILED  $1: $result"
        failed=$((failed + 1))
        return
    fi
    remove "$root"
    echo "passed  $1: $((SECONDS - began)) s, $size MB"
    passed=$((passed + 1))
}
unmount_all() {
    local left
    for left in "$work"/*/; do unmount "${left%/}"; done
}
trap unmount_all EXIT
rm -f "$work/parts"

for root_name in "$@"; do
    case $root_name in
    bookworm/bare | bookworm/desktop | bookworm/user | trixie/bare | trixie/desktop | trixie/user | sid/bare | sid/desktop | sid/user) one "$root_name" ;;
    *) echo "fresh.sh: \"$root_name\" is not {bookworm,trixie,sid}/{bare,desktop,user}" >&2; exit 2 ;;
    esac
done
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" = 0 ]
