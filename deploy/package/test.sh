#!/bin/bash
# Installs, starts, upgrades, removes and purges the package in a fresh root: test.sh OLD.deb NEW.deb (needs root and mmdebstrap).
# There is no booted systemd in it: the service is started by hand as the user and with the folders that its unit names.
set -euo pipefail
old=$(readlink -f "$1") new=$(readlink -f "$2") suite=${3:-bookworm}
root=$(mktemp -d "${TMPDIR:-/tmp}/hord-package.XXXXXX")
pid= second= broker=
clean_up() {
    for process in $pid $second $broker; do kill "$process" 2>/dev/null || true; done
    umount -l "$root/proc" 2>/dev/null || true
    rm -rf --one-file-system "$root"
}
trap clean_up EXIT
step() { printf '== %s\n' "$*"; }
die() { printf 'package test: %s\n' "$*" >&2; exit 1; }
in_root() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"; }

step "a fresh $suite root"
mmdebstrap --quiet --variant=apt --include=systemd,init-system-helpers,mosquitto,mosquitto-clients "$suite" "$root"
mount -t proc proc "$root/proc"
echo '127.0.0.1 localhost' >"$root/etc/hosts"
cp "$old" "$root/old.deb"
cp "$new" "$root/new.deb"
cp "${old/hord-station_/python3-hord_}" "$root/python.deb"

step "install"
in_root apt-get -qq update
in_root apt-get -qq -y --no-install-recommends install /old.deb >/dev/null
in_root hordctl --version
in_root hordd --check
in_root /usr/libexec/hord/hord-safe || die "hord-safe does not bring the simulated cell to its safe state"
for holder in hord-camera hord-genicam; do
    status=0
    in_root /usr/libexec/hord/$holder 2>/dev/null || status=$?  # 2: it is there with its libraries, and says that it is the station's
    [ "$status" = 2 ] || die "$holder does not start"
done
in_root hord-mqtt --check
in_root hord-page --check
for user in hord-mqtt hord-page; do
    in_root id -nG $user | grep -qw hord || die "the user $user is not in the station's group"
done
enabled() { in_root systemctl is-enabled "$1" || true; }  # it says so with its status, too
for unit in hordd.service hordd.socket; do [ "$(enabled $unit)" = enabled ] || die "$unit is not enabled at boot"; done
for unit in hord-mqtt.service hord-page.service; do [ "$(enabled $unit)" = disabled ] || die "$unit is enabled without being asked for"; done
in_root getent passwd hord | grep -q /var/lib/hord || die "the user hord was not made"
in_root bash -c '. /usr/share/bash-completion/completions/hordctl; COMP_WORDS=(hordctl rec); COMP_CWORD=1; _hordctl; [ "${COMPREPLY[*]}" = recipe ] || exit 1; COMP_WORDS=(hordctl command dis); COMP_CWORD=2; _hordctl; [ "${COMPREPLY[*]}" = disarm ]' || die "bash completion"
for page in man8/{hordd,hord-mqtt,hord-page,hord-safe,hord-camera,hord-genicam}.8 man1/{hordctl,hord-lab}.1; do [ -s "$root/usr/share/man/$page.gz" ] || die "no man page $page"; done

for link in $(grep -ohE '\]\([^):# ]+' "$root"/usr/share/doc/hord-station/*.md | cut -c3- | sort -u); do
    [ -e "$root/usr/share/doc/hord-station/$link" ] || die "an installed page links to $link, which is not installed"
done

step "the Python module, without the station's programs beside it"
in_root apt-get -qq -y --no-install-recommends install /python.deb >/dev/null
in_root python3 -c 'import hord, numpy; found = hord.inspect(numpy.zeros((90, 90), numpy.uint8)); assert found.reason == "too-dark", found; print(hord.__version__, found.explain)'
in_root apt-get -qq -y purge python3-hord >/dev/null
[ ! -e "$root/usr/lib/python3/dist-packages/hord" ] || die "the purged module left files"

step "start with the simulated cell, as its unit would"
chroot "$root" install -d -o hord -g hord -m 0750 /var/lib/hord /var/cache/hord
serve() {
    chroot --userspec=hord:hord "$root" env -i PATH=/usr/bin STATE_DIRECTORY=/var/lib/hord CACHE_DIRECTORY=/var/cache/hord /usr/bin/hordd >"$root/log" 2>&1 &
    pid=$!
    for _ in $(seq 600); do
        if grep -q 'registers at' "$root/log"; then return; fi
        kill -0 "$pid" 2>/dev/null || break
        sleep 0.5
    done
    cat "$root/log" >&2
    die "the service did not start"
}
serve
in_root hordctl status --modbus 127.0.0.1:1502 >/dev/null || die "no answer from the register server"
in_root hordctl command stop --modbus 127.0.0.1:1502 || in_root hordctl command reset --modbus 127.0.0.1:1502

# The services beside it, each as its own user.
beside() {  # beside USER PROGRAM...: its process in $second, what it says in $root/log-USER
    chroot --userspec="$1:$1" --groups="$(in_root id -g hord)" "$root" env -i PATH=/usr/bin "STATE_DIRECTORY=/var/lib/$1" "${@:2}" >"$root/log-$1" 2>&1 &
    second=$!
}
until_true() { for _ in $(seq 240); do ! "$@" >/dev/null 2>&1 || return 0; sleep 0.5; done; return 1; }
ended() { kill -TERM "$second" && wait "$second" || die "$1 did not stop with status 0"; second=; }

step "the page, for browsers and Prometheus"
beside hord-page /usr/bin/hord-page --modbus 127.0.0.1:1502 --listen 127.0.0.1:18070
metrics() (
    exec 3<>/dev/tcp/127.0.0.1/18070 || exit 1
    printf 'GET /metrics HTTP/1.0\r\nHost: 127.0.0.1:18070\r\n\r\n' >&3
    timeout 20 cat <&3 >"$root/metrics"
    grep -q '^hord_station_up 1' "$root/metrics"
)
until_true metrics || { cat "$root/log-hord-page" "$root/metrics" >&2; die "the page has no metrics of the running station"; }
ended hord-page

step "results for a broker"
chroot "$root" install -d -o hord-mqtt -g hord-mqtt -m 0750 /var/lib/hord-mqtt
beside mosquitto /usr/sbin/mosquitto -p 18830
broker=$second
heard() { in_root mosquitto_sub -h 127.0.0.1 -p 18830 -t "$1" -C 1 -W "$2" -F %t; }
until_true heard '$SYS/#' 5 || die "the broker does not answer"
sed -e 's/^# port = .*/port = 18830/' -e 's/127.0.0.1:502/127.0.0.1:1502/' "$root/etc/hord/mqtt.toml" >"$root/mqtt.toml"
beside hord-mqtt /usr/bin/hord-mqtt --config /mqtt.toml
heard 'spBv1.0/hord/+/#' 120 | grep -E 'NBIRTH|NDATA' || { cat "$root/log-hord-mqtt" >&2; die "nothing came to the broker"; }
ended hord-mqtt
kill -TERM "$broker"
broker=
kill -TERM "$pid" && wait "$pid" || die "the service did not stop with status 0"
pid=

step "upgrade: state and edited configuration stay"
echo '# edited here' >>"$root/etc/hord/hordd.toml"
echo 'kept' >"$root/var/lib/hord/state"
in_root apt-get -qq -y install /new.deb >/dev/null
[ "$(in_root dpkg-query -W -f '${Version}' hord-station)" != "$(dpkg-deb -f "$old" Version)" ] || die "not upgraded"
grep -q '# edited here' "$root/etc/hord/hordd.toml" || die "the edited configuration was lost"
grep -q kept "$root/var/lib/hord/state" || die "the state was lost"
serve
kill -TERM "$pid" && wait "$pid" || die "the upgraded service did not stop with status 0"
pid=

step "remove: programs go, configuration and state stay"
in_root apt-get -qq -y remove hord-station >/dev/null
[ ! -e "$root/usr/bin/hordd" ] || die "hordd is still there"
[ -e "$root/etc/hord/hordd.toml" ] || die "remove took the configuration"
[ -e "$root/var/lib/hord/state" ] || die "remove took the state"

step "purge: nothing is left"
in_root apt-get -qq -y purge hord-station >/dev/null
left=$(find "$root"/etc "$root"/usr "$root"/lib "$root"/var -xdev \( -path '*/var/log/*' -o -path '*/var/cache/apt/*' -o -path '*/var/lib/dpkg/*' -o -path '*/var/lib/apt/*' \) -prune -o -iname '*hord*' -print)
[ -z "$left" ] || die "left behind: $left"
! in_root getent passwd hord >/dev/null || die "the user hord is still there"
step "passed"
