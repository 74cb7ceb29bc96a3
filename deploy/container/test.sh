#!/bin/bash
# Builds the image of deploy/container and runs its four uses: the simulated station, the page, a replay worker, the MQTT
# node. test.sh PACKAGE.deb. Exit status 77, with the reason: not possible on this machine.
#
# As root buildah runs with isolation "chroot", which needs no runtime and no namespaces of its own; the containers then
# share this machine's network. Without docker.io the base image is made by mmdebstrap of the same Debian packages.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
skip() { printf 'skipped: %s\n' "$*"; exit 77; }
die() { printf 'container test: %s\n' "$*" >&2; exit 1; }
step() { printf '== %s\n' "$*"; }

package=$(ls -t $1 2>/dev/null | head -n 1) || true
[ -f "$package" ] || skip "no package at $1: ./dev package makes it"
command -v buildah >/dev/null || skip "buildah is not installed: ./dev container installs it"
[ "$(id -u)" -eq 0 ] || skip "not root: rootless containers need user namespaces and /etc/subuid, which many machines refuse; run ./dev container as root"

work=$(mktemp -d "${TMPDIR:-/tmp}/hord-container.XXXXXX")
export BUILDAH_ISOLATION=chroot
storage=(--storage-driver vfs --root "$work/storage" --runroot "$work/run")
made=()
buildah_() { buildah "${storage[@]}" "$@"; }
clean_up() {
    # Each program wrote its process id before it began: a chroot has no process ids of its own.
    for file in "$work"/volume/*.pid; do [ ! -e "$file" ] || kill "$(cat "$file")" 2>/dev/null || true; done
    wait 2>/dev/null || true
    for one in "${made[@]}"; do buildah_ rm "$one" >/dev/null 2>&1 || true; done
    umount -l "$work/storage/vfs" 2>/dev/null || true
    rm -rf --one-file-system "$work"
}
trap clean_up EXIT

step "the base image"
base=docker.io/library/debian:12-slim
if ! timeout 60 buildah "${storage[@]}" pull -q "$base" >/dev/null 2>&1; then
    command -v mmdebstrap >/dev/null || skip "docker.io does not answer, and mmdebstrap is not installed"
    mmdebstrap --quiet --variant=minbase bookworm "$work/base.tar" || skip "neither docker.io nor Debian's mirror answers"
    scratch=$(buildah_ from scratch)
    made+=("$scratch")
    buildah_ add -q "$scratch" "$work/base.tar" / >/dev/null
    base=localhost/debian:12-slim
    buildah_ commit -q "$scratch" "$base" >/dev/null || skip "buildah cannot make an image here"
    rm "$work/base.tar"
fi
probe=$(buildah_ from "$base")
made+=("$probe")
buildah_ run "$probe" -- true || skip "buildah cannot run a container here, even with isolation chroot"

step "the image"
mkdir "$work/context"
cp "$package" "$here/station.toml" "$here/Containerfile" "$work/context/"
buildah_ bud -q --build-arg "BASE=$base" --build-arg "PACKAGE=$(basename "$package")" -t hord-station "$work/context" >"$work/bud.log" 2>&1 \
    || { tail -n 20 "$work/bud.log" >&2; die "the image is not built"; }

container() {
    local name
    name=$(buildah_ from hord-station)
    made+=("$name")
    printf '%s\n' "$name"
}
mkdir -p "$work/volume"
run() {  # run CONTAINER PROGRAM...: as the image's user, with the shared volume
    buildah_ run -v "$work/volume:/var/lib/hord" "$@"
}
start() {  # start CONTAINER NAME PROGRAM...: in the background
    run "$1" -- sh -c 'echo $$ >"/var/lib/hord/$0.pid"; exec "$@"' "${@:2}" >"$work/$2.log" 2>&1 &
}
until_true() { for _ in $(seq 240); do ! "$@" >/dev/null 2>&1 || return 0; sleep 0.5; done; return 1; }

# This machine's network is shared: ports of our own.
port=$((20000 + $$ % 20000))
sed "s/^host = .*/host = \"127.0.0.1\"/; s/^port = .*/port = $port/" "$here/station.toml" >"$work/volume/station.toml"
station=$(container) page=$(container) worker=$(container)
buildah_ run --user root -v "$work/volume:/var/lib/hord" "$station" -- chown -R hord:hord /var/lib/hord

step "the simulated station"
start "$station" station hordd --config /var/lib/hord/station.toml
until_true run "$worker" -- hordctl status --modbus "127.0.0.1:$port" || { cat "$work/station.log" >&2; die "the station does not answer"; }
inspected() { run "$worker" -- hordctl results --store /var/lib/hord/store --last 3 --format csv | grep -q ',pass,\|,reject,'; }
until_true inspected || { tail "$work/station.log" >&2; die "the station stores no result"; }

step "the page"
start "$page" page hord-page --modbus "127.0.0.1:$port" --store /var/lib/hord/store --listen "127.0.0.1:$((port + 1))"
metrics() (
    exec 3<>"/dev/tcp/127.0.0.1/$((port + 1))" || exit 1
    printf 'GET /metrics HTTP/1.0\r\nHost: 127.0.0.1:%s\r\n\r\n' "$((port + 1))" >&3
    timeout 20 cat <&3 | grep -q '^hord_station_up 1'
)
until_true metrics || { cat "$work/page.log" >&2; die "the page has no metrics of the station"; }

step "a replay worker, and the MQTT node"
status=0
run "$worker" -- hordctl replay --store /var/lib/hord/store --shard 1/2 --out /var/lib/hord/shard.jsonl >"$work/replay.log" 2>&1 || status=$?
[ "$status" -le 1 ] && [ -s "$work/volume/shard.jsonl" ] || { cat "$work/replay.log" >&2; die "the replay ended with status $status"; }
run "$worker" -- hord-mqtt --check || die "the MQTT node's configuration cannot be used"
[ "$(buildah_ run "$worker" -- id -un)" = hord ] || die "the image does not run as the user hord"
step "passed"
