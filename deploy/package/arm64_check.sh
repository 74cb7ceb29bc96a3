#!/bin/bash
# Is the arm64 package the amd64 one for another processor? arm64_check.sh AMD64.deb ARM64.deb ROOT: the same files, and programs that run
# (under qemu-user, with the libraries of ROOT) and say the same, a frame's verdict to the last bit included.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
folder=$(mktemp -d "${TMPDIR:-/tmp}/hord-arm64.XXXXXX")
trap 'rm -rf "$folder"' EXIT
die() { printf 'arm64 package: %s\n' "$*" >&2; exit 1; }
step() { printf '== %s\n' "$*"; }
dpkg-deb -x "$1" "$folder/amd64"
dpkg-deb -x "$2" "$folder/arm64"
root=$(readlink -f "$3")
# A library that is one of Debian's alternatives is a link that would lead out of the root: the folders that those links mean.
alternatives=$(find "$root/etc/alternatives" -name '*-aarch64-linux-gnu' -printf '%l\n' | xargs -r -n 1 dirname | sort -u | sed "s|^|$root|" | paste -sd:)
on_amd64() { "$folder/amd64/usr/bin/$1" "${@:2}"; }
on_arm64() { qemu-aarch64-static -L "$root" -E "LD_LIBRARY_PATH=$alternatives" "$folder/arm64/usr/bin/$1" "${@:2}"; }
the_same() {  # the_same PROGRAM ARGUMENT...: prints what both say
    on_amd64 "$@" >"$folder/one" 2>&1 || die "$* on amd64: $(cat "$folder/one")"
    on_arm64 "$@" >"$folder/two" 2>&1 || die "$* on arm64: $(cat "$folder/two")"
    cmp -s "$folder/one" "$folder/two" || { diff "$folder/one" "$folder/two" >&2; die "$* says something else on arm64"; }
    printf '%-40s the same, %s bytes\n' "$*" "$(stat -c %s "$folder/one")"
}

step "the same files"
for arch in amd64 arm64; do (cd "$folder/$arch" && find . -printf '%y %m %p\n' | LC_ALL=C sort) >"$folder/$arch.list"; done
diff "$folder/amd64.list" "$folder/arm64.list" || die "the packages hold different files"
[ "$(dpkg-deb -f "$2" Architecture)" = arm64 ] || die "its architecture is not arm64"
wc -l <"$folder/arm64.list"

step "the same programs"
for program in hordctl hordd hord-lab hord-mqtt hord-page; do
    readelf -h "$folder/arm64/usr/bin/$program" | grep -q 'Machine: *AArch64' || die "$program is not for arm64"
    the_same "$program" --version
done
the_same ../libexec/hord/hord-safe --version
# Those that only the station starts say so, with all of their libraries loaded.
for program in hord-camera hord-genicam; do
    for arch in amd64 arm64; do
        status=0
        "on_$arch" "../libexec/hord/$program" >"$folder/$arch.says" 2>&1 || status=$?
        [ "$status" -eq 2 ] || die "$program ends with $status on $arch: $(cat "$folder/$arch.says")"
        sed -i "s|$folder/$arch||" "$folder/$arch.says"
    done
    cmp "$folder/amd64.says" "$folder/arm64.says" || die "$program says something else on arm64"
    printf '%-40s the same\n' "$program"
done
for format in json csv md st; do the_same hordctl registers --format "$format"; done
the_same hordd --catalog
the_same hordd --config "$folder/arm64/etc/hord/hordd.toml" --check
the_same hord-mqtt --config "$folder/arm64/etc/hord/mqtt.toml" --check
the_same hord-page --config "$folder/arm64/etc/hord/page.toml" --check

step "a station that is not there"
status=0
on_arm64 hordctl status --modbus 127.0.0.1:1 >"$folder/one" 2>"$folder/two" || status=$?
cat "$folder/two"
[ "$status" -eq 2 ] && [ ! -s "$folder/one" ] && [ "$(wc -l <"$folder/two")" -eq 1 ] || die "hordctl status ends with $status"

step "a frame, drawn on amd64 and judged on both"
on_amd64 hord-lab render hal_sim/scenes/bubble.toml --out "$folder/frame.png" --seed 1 >/dev/null 2>&1 || die "no frame can be drawn"
for arch in amd64 arm64; do
    status=0
    "on_$arch" hordctl inspect "$folder/frame.png" --macro 9x9 --json --out "$folder/maps-$arch" >"$folder/$arch.json" || status=$?
    [ "$status" -le 1 ] || die "inspect ends with $status on $arch"
    sed -i -E 's/"ms":\{[^}]*\},?//' "$folder/$arch.json"
done
cmp "$folder/amd64.json" "$folder/arm64.json" || die "the verdict differs"
cut -c1-200 "$folder/arm64.json"
for map in "$folder"/maps-amd64/*.tiff; do cmp "$map" "$folder/maps-arm64/$(basename "$map")" || die "$(basename "$map") differs"; done
step "the simulated line, run on both"
for arch in amd64 arm64; do
    "on_$arch" hordctl run --simulate --parts 6 --rate 0.5 --variety 1 --seed 1 --json >"$folder/$arch.line" 2>"$folder/$arch.said" ||
        die "the line ends with $? on $arch: $(tail -n 5 "$folder/$arch.said")"
    sed -E 's/^.*"part":([0-9]+).*$/\1 &/' "$folder/$arch.line" | sort -n | grep -oE '"(verdict|reason|ejected)":[^,}]*' >"$folder/$arch.verdicts"
done
cmp "$folder/amd64.verdicts" "$folder/arm64.verdicts" || { diff "$folder/amd64.verdicts" "$folder/arm64.verdicts"; die "the line's verdicts differ"; }
grep -c verdict "$folder/arm64.verdicts"
step "passed"
