#!/bin/sh
# A base image from Debian's packages alone, for machines that reach no container registry:
#
#   docker/base-image.sh [TAG]        # crossfix-base by default; takes a minute, needs root
#
# It has what we need of python:3.11-slim: a shell, python3, its venv module, and libstdc++ for numpy.
set -eu
tag=${1:-crossfix-base}
mirror=${MIRROR:-http://deb.debian.org/debian}

command -v mmdebstrap >/dev/null || { # half the time of debootstrap, and a tar archive at once
    echo "needs mmdebstrap: apt-get install mmdebstrap" >&2
    exit 1
}
root_tar=$(mktemp)
trap 'rm -f "$root_tar"' EXIT
mmdebstrap --quiet --variant=essential --include=python3,python3-venv,libstdc++6 \
    --dpkgopt='path-exclude=/usr/share/doc/*' \
    --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/locale/*' \
    bookworm - "$mirror" >"$root_tar"
docker import --change 'CMD ["/bin/sh"]' "$root_tar" "$tag"
