#!/bin/bash
# The Debian packages: build.sh [amd64|arm64] [VERSION]. Leaves build/package/hord-station_VERSION_ARCH.deb, whose name is
# the last line, and (amd64) python3-hord_VERSION_ARCH.deb, and has lintian read them.
# arm64 is cross-built: run it where the arm64 libraries are (deploy/package/arm64.sh makes such a root).
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
arch=${1:-amd64} out=build/package
version=${2:-$(sed -n 's/^project(hord-station VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)}
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}

mkdir -p "$out/made"
changelog() {  # changelog PACKAGE PAGE
    printf '%s (%s) unstable; urgency=medium\n\n  * See /usr/share/doc/%s/%s and the journal of the repository.\n\n' "$1" "$version" "$1" "$2"
    printf ' -- HORD station maintainers <hord-station@example.org>  %s\n' "$(date -u -R -d "@$SOURCE_DATE_EPOCH")"
}
changelog hord-station plc.md | gzip -9n >"$out/made/changelog.gz"
changelog python3-hord python.md | gzip -9n >"$out/made/changelog-python.gz"

# The pages for those who run a station. A link to a page that is not installed becomes plain text.
pages='commands|fleet|mistakes|mqtt|page|plc|registers|service|store'
rm -rf "$out/made/doc"
mkdir "$out/made/doc"
for page in ${pages//|/ }; do
    sed -E "s#\]\((($pages)\.md|[^):]*://|\#)#]\n\1#g; s#\[([^]]*)\]\([^)]*\)#\1#g; s#\]\n#](#g" "docs/$page.md" >"$out/made/doc/$page.md"
done
mkdir -p "$out/made/python"
sed -E 's#\[([^]]*)\]\([^):]*\)#\1#g' docs/python.md >"$out/made/python/python.md"

options=()
tree=build/release  # what is tested is what is packaged
[ -e "$tree/CMakeCache.txt" ] || options+=(-DHORD_TESTS=OFF)  # in a fresh checkout the tests' packages may be missing
if [ "$arch" = arm64 ]; then
    [ -d "$out/made/man" ] || { echo "build the amd64 package first: the man pages come from its programs" >&2; exit 2; }
    tree=$out/tree-arm64
    options+=(-B "$tree" -DHORD_TESTS=OFF -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 -DCMAKE_C_COMPILER=aarch64-linux-gnu-gcc
        -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ -DCMAKE_LIBRARY_ARCHITECTURE=aarch64-linux-gnu -DCMAKE_STRIP=/usr/bin/aarch64-linux-gnu-strip
        -DCMAKE_FIND_ROOT_PATH=/usr/aarch64-linux-gnu)
    export PKG_CONFIG_LIBDIR=/usr/lib/aarch64-linux-gnu/pkgconfig:/usr/share/pkgconfig
fi
cmake --preset release "${options[@]}" >"$out/configure-$arch.log" || { cat "$out/configure-$arch.log" >&2; exit 1; }
cmake --build "$tree" --target hordd hord-safe hord-camera hord-genicam hordctl hord-lab hord-mqtt hord-page $([ "$arch" = arm64 ] || echo _hord) -j "$(nproc)"
[ "$arch" = arm64 ] || deploy/package/man.sh "$tree/bin" "$out/made/man" "$version"
cpack --config "$tree/CPackConfig.cmake" -B "$out/cpack-files-$arch" -D "CPACK_PACKAGE_VERSION=$version" >"$out/cpack-$arch.log" || { cat "$out/cpack-$arch.log" >&2; exit 1; }
for package in python3-hord hord-station; do
    deb=$out/${package}_${version}_$arch.deb
    [ "$package" = hord-station ] || [ "$arch" != arm64 ] || continue  # the module is not cross-built
    mv "$out/cpack-files-$arch/$(basename "$deb")" "$deb"
    lintian --fail-on error "$deb"
    echo "$deb"
done
