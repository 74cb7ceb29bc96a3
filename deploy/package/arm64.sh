#!/bin/bash
# Cross-builds the arm64 package in a root with Debian's cross compiler and arm64 libraries: arm64.sh [SUITE] (needs root, mmdebstrap,
# and the amd64 package built before: its man pages are used). The root is kept in build/package/root-arm64 for the next time.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
suite=${1:-bookworm} root=$PWD/build/package/root-arm64
libraries=(libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev libceres-dev libmodbus-dev libgpiod-dev libcamera-dev libsystemd-dev libsqlite3-dev libmd-dev libmosquitto-dev
    libpng-dev libtomlplusplus-dev libfmt-dev libcpp-httplib-dev prometheus-cpp-dev)
headers=(libexpected-dev libcli11-dev nlohmann-json3-dev)
tools=(crossbuild-essential-arm64 cmake ninja-build pkg-config git lintian ca-certificates)
if [ ! -e "$root/etc/debian_version" ]; then
    include=$(IFS=,; echo "${tools[*]},${headers[*]},$(printf '%s:arm64,' "${libraries[@]}")")
    mmdebstrap --quiet --variant=apt --architectures=amd64,arm64 --include="${include%,}" "$suite" "$root"
fi
mkdir -p "$root/hord-station"
mount --bind "$PWD" "$root/hord-station"
mount -t proc proc "$root/proc"
trap 'umount -l "$root/hord-station" "$root/proc"' EXIT
chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root git config --global --add safe.directory /hord-station
chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root /hord-station/deploy/package/build.sh arm64
