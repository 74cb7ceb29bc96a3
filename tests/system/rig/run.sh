#!/bin/bash
# The rig: a virtual machine with real device nodes, in which the package is installed and the station runs on its real drivers above
# the simulated world (./dev rig; docs/hardware.md). run.sh PACKAGE.deb [latency]; needs root once, to make the
# machine's root. With "latency" it only measures the times of `hordctl latency` and writes docs/results/rig-latency.md.
#   HORD_RIG_CACHE   cache folder of the machine's parts      (~/.cache/hord-rig)
#   HORD_RIG_ACCEL   kvm or tcg                               (kvm where it works)
#   HORD_RIG_KILLS   how often the service is killed          (6, each phase of a part's way once)
#   HORD_RIG_CUTS    how often the power is cut               (1)
#   HORD_RIG_ONLY    a pattern: only checks of these names    (all)
#   HORD_RIG_SEED    seed of random moments and parts         (1)
#   HORD_RIG_SHIFT   virtual time: 2^n ns an instruction      (0)
#   HORD_RIG_EDGES   number measured, idle and busy           (100; latency: 1000)
#   HORD_RIG_LIMIT   s; time limit of all machines together   (1800)
#   HORD_RIG_OUT     logs, and the machine's input            (build/rig)
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
deb=$1 what=${2:-all} bin=build/release/bin out=${HORD_RIG_OUT:-build/rig}
cache=${HORD_RIG_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/hord-rig}
kills=${HORD_RIG_KILLS:-6} limit=${HORD_RIG_LIMIT:-1800} cuts=${HORD_RIG_CUTS:-1} seed=${HORD_RIG_SEED:-1} shift=${HORD_RIG_SHIFT:-0}
edges=${HORD_RIG_EDGES:-100}
[ "$what" = all ] || edges=${HORD_RIG_EDGES:-1000}
die() { printf 'rig: %s\n' "$*" >&2; exit 2; }
RANDOM=$seed

mkdir -p "$out"
printf 'the machine (kept in %s)\n' "$cache"
# The dependencies of the package and the tools are part of the machine's root, so that installing needs no network.
mapfile -t dependencies < <(dpkg-deb -f "$deb" Depends | tr ',' '\n' | sed 's/(.*//; s/|.*//; s/ //g' | sort -u)
tests/system/rig/machine.sh "$cache" "${dependencies[@]}"
spent() {  # s of processor time of this script's programs: the second line of what times says, minutes and seconds in programs and in the kernel
    times >"$out/times"
    processor=$(sed -n '2s/[ms]/ /gp' "$out/times" | awk '{printf "%.0f", $1 * 60 + $2 + $3 * 60 + $4}')
}
spent
printf '   there after %s s, %s s of processor time\n' "$SECONDS" "$processor"

# KVM can exist and open, and still run nothing (nested virtual machines): only output from a booted kernel proves that it works.
kvm_works() {
    [ -r /dev/kvm ] && [ -w /dev/kvm ] || return 1
    timeout 10 qemu-system-x86_64 -accel kvm -M q35 -cpu host -m 256 -nodefaults -display none -no-reboot -kernel "$cache/vmlinuz" \
        -append "console=ttyS0 earlyprintk=ttyS0 panic=-1" -serial stdio </dev/null 2>/dev/null | grep -qam1 'Linux version'
}
accel=${HORD_RIG_ACCEL:-}
[ -n "$accel" ] || { kvm_works && accel=kvm || accel=tcg; }

# ---- input of this run: the package, the tools, the frames

printf 'frames\n'
rm -rf "$out/payload" "$out/frames"
mkdir -p "$out/frames"
for scene in tests/system/rig/scenes/*.toml; do
    "$bin/hord-lab" render "$scene" --seed "$seed" --out "$out/frames/$(basename "$scene" .toml).png" >/dev/null 2>&1 || die "$scene cannot be rendered"
done
# The expected verdict for each, from the same software in one process.
"$bin/hordctl" inspect "$out"/frames/*.png --macro 9x9 --json >"$out/verdicts.json" || [ $? = 1 ]
for frame in "$out"/frames/*.png; do
    want=reject
    case $(basename "$frame") in good*) want=pass ;; empty*) want=unfit ;; esac
    grep -F "$(basename "$frame")" "$out/verdicts.json" | grep -q "\"verdict\": *\"$want\"" || die "$frame is not judged as $want in process: see $out/verdicts.json"
done

for frame in "$out"/frames/*.png; do "$bin/hord_rig_frames" "$frame" "${frame%.png}.pgm"; done

payload=$out/payload
mkdir -p "$payload"/opt/rig "$payload"/etc/modprobe.d "$payload"/etc/systemd/system/{sysinit.target.wants,multi-user.target.wants} "$payload/var"
cp -a "$cache/modules/." "$payload/"
cp tests/system/rig/guest/{devices.sh,checks.sh,hordd.toml,latency.toml} "$payload/opt/rig/"
cp deploy/genicam.conf "$payload/opt/rig/"
cp tests/system/rig/guest/modprobe.conf "$payload/etc/modprobe.d/rig.conf"
cp tests/system/rig/guest/*.service "$payload/etc/systemd/system/"
install -D -m644 tests/system/rig/guest/slow.conf "$payload/etc/systemd/system/hordd.service.d/slow.conf"
ln -s ../rig-devices.service "$payload/etc/systemd/system/sysinit.target.wants/"
ln -s ../rig-checks.service ../rig-camera.service "$payload/etc/systemd/system/multi-user.target.wants/"
while read -r unit; do ln -s /dev/null "$payload/etc/systemd/system/$unit"; done <tests/system/rig/guest/mask
cp "$deb" "$payload/opt/rig/hord-station.deb"
mkdir "$payload/opt/rig/frames"
cp "$out"/frames/*.pgm "$payload/opt/rig/frames/"
for tool in test_contract hord-camera hord_fake_gige hord_rig_world; do
    cp "$bin/$tool" "$payload/opt/rig/"
    strip --strip-debug "$payload/opt/rig/$tool"
done
touch "$payload/etc/.updated" "$payload/var/.updated"
mksquashfs "$payload" "$out/payload.squashfs" -comp zstd -Xcompression-level 3 -noappend -quiet -no-progress -all-root
rm -rf "$payload"
rm -f "$out/disk.img"
truncate -s 1G "$out/disk.img"
mkfs.ext4 -q -F "$out/disk.img"

# ---- the machine runs

say_checks() { sed -u 's/\r//g; s/^.*\(RIG [A-Z #|]\)/\1/' | grep --line-buffered -aE '^RIG (PASS|FAIL|START|RESULT|CUT|  ?\|)' | sed -u "s/^RIG //; s/^ | LATENCY /   /; s/^/$1: /"; }

# Writes the cost of the machine at each keyword of its log to LOG.cost: KEYWORD NAME, the emulator's processor time in 0.01 s, wall clock in ms.
# The log is followed by a reader, so times may be slightly late.
note_costs() {  # note_costs QEMU LOG
    local word stat
    tail -n +1 -f --pid="$1" "$2" | grep --line-buffered -aoE 'RIG (START|BEGIN|PASS|FAIL|RESULT) ?[a-z0-9-]*' | while read -r _ word; do
        read -r -a stat <"/proc/$1/stat" || break
        echo "$word $((stat[13] + stat[14])) $(($(date +%s%N) / 1000000))"
    done >"$2.cost" 2>/dev/null
}
# cost_of NAME: processor time and wall time (s) of this check in all machines; "start": the time before the first check.
cost_of() {
    awk -v name="$1" '
        FNR == 1 {cpu = 0; wall = 0}
        $1 == "BEGIN" {cpu = $3; wall = $4; at = $2}
        name == "start" && $1 == "START" {c += $(NF - 1) / 100}
        ($1 == "PASS" || $1 == "FAIL") && $2 == name && at == name {c += ($3 - cpu) / 100; w += ($4 - wall) / 1000}
        END {printf "%.1f %.1f", c, w}' "$out"/*.log.cost
}

qemu=  # process of the running machine
end_machine='[ -z "$qemu" ] || kill -KILL "$qemu" 2>/dev/null; exit 130'

# The check in which a log ends.
stood() { awk '/^RIG BEGIN / {at = $3} /^RIG (PASS|FAIL) / {at = ""} END {print at == "" ? "between two checks" : "in the check " at}' "$1"; }

boot() {  # boot MACHINE PHASE LOG [kernel argument...]: runs until power off or power cut. Fails at the time limit.
    local machine=$1 phase=$2 log=$3 cut_at= over= options
    shift 3
    case $machine in
        kvm) options=(-accel kvm -cpu host -smp 2 -m 768) ;;
        tcg) options=(-accel tcg,thread=single,tb-size=256 -cpu max,la57=off -icount "shift=$shift,sleep=on" -rtc clock=vm -m 768) ;;
        virtual)
            # Two UARTs of one card, wired to each other.
            rm -f "$out/wire"
            options=(-accel tcg,thread=single,tb-size=256 -cpu max,la57=off -m 1024 -icount "shift=$shift,sleep=off" -rtc clock=vm
                -chardev "socket,id=w0,path=$out/wire,server=on,wait=off" -chardev "socket,id=w1,path=$out/wire" -device pci-serial-2x,chardev1=w0,chardev2=w1)
            set -- rig.memory "$@"
            ;;
    esac
    : >"$log"
    options+=(-drive "file=$cache/base.squashfs,format=raw,if=none,id=d0,readonly=on" -device virtio-blk-pci,drive=d0
        -drive "file=$out/payload.squashfs,format=raw,if=none,id=d1,readonly=on" -device virtio-blk-pci,drive=d1)
    [ "$machine" = virtual ] || options+=(-drive "file=$out/disk.img,format=raw,if=none,id=d2,cache=writeback" -device virtio-blk-pci,drive=d2)
    qemu-system-x86_64 -name hord-rig -M q35 "${options[@]}" -nodefaults -display none -no-reboot \
        -kernel "$cache/vmlinuz" -initrd "$cache/initrd.img" \
        -append "console=ttyS0 clocksource=tsc tsc=reliable quiet loglevel=4 panic=-1 net.ifnames=0 mitigations=off random.trust_cpu=on systemd.show_status=false rig.phase=$phase rig.kills=$kills rig.edges=$edges rig.seed=$seed ${HORD_RIG_ONLY:+rig.only=$HORD_RIG_ONLY} $*" \
        -chardev stdio,id=con,signal=off -device isa-serial,chardev=con \
        </dev/null >"$log" 2>&1 &
    qemu=$!
    tail -n +1 -f --pid=$qemu "$log" | say_checks "$phase" &
    local teller=$! notes
    note_costs $qemu "$log" &
    notes=$!
    while kill -0 $qemu 2>/dev/null; do
        if [ $SECONDS -ge $deadline ]; then
            over=1
            kill -KILL $qemu
        fi
        if [ -z "$cut_at" ] && grep -qa 'RIG ACKNOWLEDGED' "$log"; then cut_at=$(($(date +%s%N) / 1000000 + 1000 + RANDOM % 10000)); fi
        if [ -n "$cut_at" ] && [ $(($(date +%s%N) / 1000000)) -ge "$cut_at" ]; then
            kill -KILL $qemu  # power cut, not an orderly shutdown
            break
        fi
        sleep 0.2
    done
    wait $qemu 2>/dev/null || true
    qemu=
    wait $teller || true
    wait $notes || true
    if [ -n "$cut_at" ]; then
        printf 'RIG PASS fault-power-cut 0\n' >>"$log"
        echo "$phase: PASS fault-power-cut"
    fi
    tr -d '\r' <"$log" | grep -a 'RIG ' | sed 's/^.*\(RIG [A-Z #|]\)/\1/' >"$log.rig" || true
    if [ -n "$over" ]; then
        printf 'rig: %s s are over: the machine of phase "%s" was ended; it stood %s; the last it said (%s):\n' "$limit" "$phase" "$(stood "$log.rig")" "$log"
        tail -n 5 "$log"
        return 1
    fi
    grep -q '^RIG START' "$log.rig" || { tail -n 30 "$log"; die "the machine did not come up: see $log"; }
    [ -n "$cut_at" ] || grep -q '^RIG RESULT' "$log.rig" || { tail -n 30 "$log"; die "the machine ended $(stood "$log.rig"): see $log"; }
}

began=$(date +%s) deadline=$((SECONDS + limit))
rm -f "$out"/*.log "$out"/*.rig "$out"/*.cost
say_boot() { printf '== %s: %s (%s)\n' "$1" "$2" "${3:-$accel}"; }
# The checks of a phase, as listed in guest/checks.sh, and whether any of them is selected.
checks_of() { sed -n "/^    $1)/,/;;/s/^        check \([a-z0-9-]*\) .*/\1/p" tests/system/rig/guest/checks.sh; }
wanted() {
    local name
    for name in $(for phase in "$@"; do checks_of "$phase"; done); do
        ! [[ $name =~ ${HORD_RIG_ONLY:-.} ]] || return 0
    done
    return 1
}

if [ "$what" = latency ]; then
    trap "$end_machine" INT TERM
    say_boot latency "on device nodes" "virtual time, 2^$shift ns an instruction"
    boot virtual latency "$out/latency.log"
    exec tests/system/rig/latency.sh "$out/latency.log.rig" "$shift" "$edges"
fi

kept() { sed -n 's/^RIG ACKNOWLEDGED \([0-9]*\) \([0-9]*\).*/\1.\2/p' "$1.rig" | tail -n 1; }
on_the_disk() {  # one boot after the other
    trap "$end_machine" TERM
    local last=$out/1-install.log k
    RANDOM=$seed
    wanted install cut boot || return 0
    say_boot install "first boot: contracts, package, faults, a power cut"
    boot "$accel" install "$out/1-install.log"
    for k in $(seq 2 "$cuts"); do
        say_boot cut "power cut $k"
        boot "$accel" cut "$out/cut-$k.log" "rig.kept=$(kept "$last")"
        last=$out/cut-$k.log
    done
    wanted boot || return 0
    say_boot boot "after the power cut"
    boot "$accel" boot "$out/9-boot.log" "rig.kept=$(kept "$last")"
}
in_memory() {
    trap "$end_machine" TERM
    wanted time || return 0
    say_boot time "line, faults, kills, latency" "virtual time, 2^$shift ns an instruction"
    boot virtual time "$out/10-time.log"
}
# In parallel: the chains are independent, and one of them uses one thread.
on_the_disk &
chains=($!)
in_memory &
chains+=($!)
trap 'kill "${chains[@]}" 2>/dev/null; exit 130' INT TERM
for chain in "${chains[@]}"; do wait "$chain" || true; done  # missing checks appear in the summary

# ---- the summary: every check that was announced must have reported

cat "$out"/*.rig >"$out/all.rig" 2>/dev/null || true
announced=$(for phase in install cut boot time; do checks_of $phase; done | awk '!seen[$0]++')
printf '\n%-46s %-6s %10s %12s %10s\n' check outcome "machine, s" "processor, s" "wall, s"
failed=0
for name in $announced; do
    [[ $name =~ ${HORD_RIG_ONLY:-.} ]] || continue
    line=$(grep -E "^RIG (PASS|FAIL) $name " "$out/all.rig" | tail -n 1 || true)
    outcome=$(cut -d' ' -f2 <<<"$line") ms=$(cut -d' ' -f4 <<<"$line")
    ! grep -qE "^RIG FAIL $name " "$out/all.rig" || outcome=FAIL
    [ "$outcome" = PASS ] || failed=$((failed + 1))
    if [ -z "$outcome" ]; then grep -qE "^RIG BEGIN $name$" "$out/all.rig" && outcome='BEGUN, NOT ENDED' || outcome='NEVER BEGUN'; fi
    read -r cpu wall <<<"$(cost_of "$name")"
    printf '%-46s %-6s %10s %12s %10s\n' "$name" "$outcome" "$(awk -v ms="${ms:-0}" 'BEGIN {printf "%.1f", ms / 1000}')" "$cpu" "$wall"
done
printf '%-46s %-6s %10s %12s\n' 'the machines until their first check' '' '' "$(cost_of start | cut -d' ' -f1)"
spent
printf '%s checks announced%s, %s failed or missing; seed %s, %s kills; %s s with %s, %s s of processor time; logs in %s\n' "$(wc -w <<<"$announced")" \
    "${HORD_RIG_ONLY:+, only those like $HORD_RIG_ONLY run}" "$failed" "$seed" "$kills" $(($(date +%s) - began)) "$accel" "$processor" "$out"
[ "$failed" = 0 ]
