#!/bin/bash
# Cross-builds the arm64 package in a root with Debian's cross compiler and arm64 libraries: arm64.sh [SUITE] (needs root, mmdebstrap,
# qemu-user-static, and the amd64 package built before: its man pages are used). Then compares it with the amd64 one and runs its programs
# (arm64_check.sh). The root is kept in build/package/root-arm64 for the next time.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
suite=${1:-bookworm} root=$PWD/build/package/root-arm64
libraries=(libopencv-core-dev libopencv-imgproc-dev libceres-dev libmodbus-dev libgpiod-dev libcamera-dev libaravis-dev libusb-1.0-0-dev libsystemd-dev libsqlite3-dev libmd-dev libmosquitto-dev
    libpng-dev libtiff-dev libhdf5-dev libtomlplusplus-dev libfmt-dev libmicrohttpd-dev prometheus-cpp-dev)
headers=(libexpected-dev libcli11-dev nlohmann-json3-dev)
tools=(crossbuild-essential-arm64 cmake ninja-build pkg-config lintian)
mkdir -p build/package
if [ ! -e "$root" ]; then
    include=$(IFS=,; echo "${tools[*]},${headers[*]},$(printf '%s:arm64,' "${libraries[@]}")")
    rm -rf --one-file-system "$root.part"
    mmdebstrap --quiet --variant=apt --architectures=amd64,arm64 --include="${include%,}" "$suite" "$root.part"
    mv "$root.part" "$root"
fi
mkdir -p "$root/hord-station"
mount --bind "$PWD" "$root/hord-station"
trap 'umount -l "$root/hord-station" "$root/proc" 2>/dev/null || true' EXIT
mount -t proc proc "$root/proc"
epoch=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}  # of the commit: the same as the amd64 package's
chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root SOURCE_DATE_EPOCH="$epoch" /hord-station/deploy/package/build.sh arm64
umount -l "$root/hord-station" "$root/proc"
trap - EXIT
version=$(sed -n 's/^project(hord-station VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
deploy/package/arm64_check.sh "build/package/hord-station_${version}_amd64.deb" "build/package/hord-station_${version}_arm64.deb" "$root"
