# shellcheck shell=sh
# apt.sh - for other scripts: apt with separate sources, lists and status, which needs no root rights and leaves
# this system's as they are.
#
# MIRROR and SUITE choose another Debian than the one in use here.

begin_apt() { # FOLDER deb|deb-src ARCH
    apt_folder=$1 apt_arch=$3
    mkdir -p "$1/lists/partial" "$1/cache/archives/partial"
    : >"$1/status"
    if [ -z "${MIRROR:-}" ]; then
        # shellcheck disable=SC2016 # apt-get expands it
        MIRROR=$(apt-get indextargets --format '$(SITE)' 'Origin: Debian' 2>/dev/null | head -n 1)
        [ -n "$MIRROR" ] || MIRROR=http://deb.debian.org/debian
    fi
    echo "$2 [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $MIRROR ${SUITE:-bookworm} main" \
        >"$1/sources.list"
    private_apt update
}

private_apt() {
    apt-get -qq -o APT::Architecture="$apt_arch" -o APT::Architectures::="$apt_arch" -o APT::Install-Recommends=0 \
        -o APT::Sandbox::User=root -o Debug::NoLocking=1 -o Dir::Etc::sourcelist="$apt_folder/sources.list" \
        -o Dir::Etc::sourceparts=/dev/null -o Dir::State::lists="$apt_folder/lists" \
        -o Dir::State::status="$apt_folder/status" -o Dir::Cache="$apt_folder/cache" "$@"
}
