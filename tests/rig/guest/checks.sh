#!/bin/bash
# Runs inside the machine. Every check says "RIG PASS|FAIL name milliseconds"; what it saw stands before that, behind "RIG  | ".
# `rig.phase` on the kernel's command line: install (first boot, ends in a power cut), boot (after it).
set -u
chip=/sys/kernel/config/gpio-sim/rig
world=/opt/rig/hord_rig_world
phase=$(sed -n 's/.*rig\.phase=\([a-z]*\).*/\1/p' /proc/cmdline)
kills=$(sed -n 's/.*rig\.kills=\([0-9]*\).*/\1/p' /proc/cmdline)
seed=$(sed -n 's/.*rig\.seed=\([0-9]*\).*/\1/p' /proc/cmdline)
only=$(sed -n 's/.*rig\.only=\([^ ]*\).*/\1/p' /proc/cmdline)  # a pattern of names, to look into one
RANDOM=${seed:-1}
pass=0 fail=0
say() { printf 'RIG %s\n' "$*"; }
now_ms() { awk '{print int($1 * 1000)}' /proc/uptime; }

check() {  # check NAME COMMAND...: everything it prints is shown
    local name=$1 began rc
    shift
    [[ $name =~ ${only:-.} ]] || return 0
    began=$(now_ms)
    "$@" 2>&1 | sed -u 's/^/RIG  | /'
    rc=${PIPESTATUS[0]}
    if [ $rc = 0 ]; then pass=$((pass + 1)); say PASS "$name" "$(($(now_ms) - began))"; else fail=$((fail + 1)); say FAIL "$name" "$(($(now_ms) - began))"; fi
}

wait_for() {  # wait_for SECONDS COMMAND...
    local until=$(($(now_ms) + $1 * 1000))
    shift
    until "$@" >/dev/null 2>&1; do
        [ "$(now_ms)" -lt $until ] || { echo "waited in vain for: $*"; return 1; }
        sleep 0.1
    done
}

# -- the seam ---------------------------------------------------------------------------------------------------

# contract FILTER: a suite of tests/contract on a real device; nothing may be left out.
contract() {
    /opt/rig/test_contract --gtest_brief=1 --gtest_filter="$1" >/tmp/contract 2>&1
    local rc=$?
    grep -vE '^\[==|^Note|^Running|^$' /tmp/contract | tail -n 25
    [ $rc = 0 ] && ! grep -q SKIPPED /tmp/contract && grep -qE 'PASSED  \] [1-9]' /tmp/contract
}

devices() {
    gpiodetect
    gpioinfo rig-gpio | head -n 6
    v4l2-ctl --list-devices 2>/dev/null | tr -s '\n\t ' ' '
    echo
    [ -c /dev/gpiochip0 ] && [ -c /dev/video10 ] && [ -c /dev/video11 ] && [ -c /dev/video20 ] && [ "$(cat /proc/1/comm)" = systemd ]
}

contract_video_loopback() {
    $world camera --video /dev/video11 >/dev/null 2>&1 &
    local camera=$!
    sleep 1
    # How a device is lost is shown on the other one: this one never is.
    HORD_V4L2_DEVICE=/dev/video11 contract 'V4l2/*-*a_loss_is_told_once*'
    local rc=$?
    kill $camera
    wait $camera 2>/dev/null
    return $rc
}
contract_video_vivid() {
    v4l2-ctl -d /dev/video20 -v width=320,height=180,pixelformat=GREY -p 5 >/dev/null 2>&1
    v4l2-ctl -d /dev/video20 -c timestamp_source=1  # of the start of the frame: that of its end lies in the future
    HORD_V4L2_LOSE='v4l2-ctl -d /dev/video20 -c inject_fatal_streaming_error=1' HORD_V4L2_DEVICE=/dev/video20 contract 'V4l2/*'
}

# -- the installed station --------------------------------------------------------------------------------------

# As the service tells systemd: asking over Modbus means starting a program, which takes seconds on an emulated processor.
state() { systemctl show -P StatusText hordd | cut -d, -f1; }
executes() { [ "$(state)" = ContinuousExecution ]; }
not_executing() { ! executes; }
hordd_active() { [ "$(systemctl is-active hordd)" = active ]; }
journal_says() { journalctl -u hordd -o cat | grep -q "$1"; }
lamps_dark() { [ "$(cat "$(line_folder 0)/value")$(cat "$(line_folder 1)/value")" = 00 ]; }
line_folder() { echo "/sys/devices/platform/$(cat $chip/dev_name)/$(cat $chip/bank0/chip_name)/sim_gpio$1"; }

install_package() {
    mkdir -p /etc/hord
    start_world /tmp/install --parts 1000 || return 1  # the camera is on, the module answers
    cp /opt/rig/hordd.toml /etc/hord/hordd.toml  # kept: the package does not overwrite an edited configuration
    dpkg -i --force-confold /opt/rig/hord-station.deb || return 1
    cmp /opt/rig/hordd.toml /etc/hord/hordd.toml || return 1
    wait_for 120 hordd_active || { systemctl status hordd --no-pager; journalctl -u hordd -o cat | tail -n 20; return 1; }
    systemctl show -P StatusText hordd
    ls -l /dev/gpiochip0 /dev/video10
    stop_world
}

security() {
    systemd-analyze security hordd --no-pager | tail -n 1
    local exposure
    exposure=$(systemd-analyze security hordd --no-pager | sed -n 's/.*: \([0-9.]*\) .*/\1/p' | tail -n 1)
    awk -v e="$exposure" 'BEGIN {exit !(e > 0 && e <= 1.7)}'
}

start_world() {  # start_world LOG ARGUMENT...
    local log=$1
    shift
    $world line --chip $chip --video /dev/video10 --frames /opt/rig/frames "$@" >"$log" 2>&1 &
    world_pid=$!
    wait_for 60 grep -q ' ready' "$log" || { cat "$log"; return 1; }
}

stop_world() {
    kill "$world_pid"
    wait "$world_pid" 2>/dev/null
    return 0
}

# Whatever it does now, it executes afterwards: by itself, or once a person has reset it.
to_execution() {
    local k
    for k in 1 2 3 4; do
        wait_for 10 executes >/dev/null && return 0
        hordctl command reset 2>&1
        wait_for 20 executes >/dev/null && return 0
        hordctl command start_continuous 2>&1
    done
    wait_for 30 executes || { systemctl show -P StatusText hordd; return 1; }
}

whole_line() {
    start_world /tmp/line --parts 16 --seed "${seed:-1}" --patience 150 --faults '3=bounce,5=no-frame,7=short-frame,9=late-frame,11=twice,13=camera-gone' || return 1
    to_execution || { stop_world; return 1; }
    wait $world_pid
    local rc=$?
    grep -E ' (gone|totals) ' /tmp/line | cut -d' ' -f2-
    hordctl results --format csv --last 16 | cut -d, -f5-8,15-16 2>/dev/null
    systemctl show -P StatusText hordd
    [ $rc = 0 ]
}

# Light and output while the line ran: never longer than the channel stands, dark and at rest afterwards.
lights_in_limits() {
    awk '$2 == "lamps" && $3 != 0 && !on {on = $1; n++} $2 == "lamps" && $3 == 0 && on {d = ($1 - on) * 1000; on = 0; if (d > worst) worst = d; }
         END {printf "%d flashes, longest %.1f ms by the simulator'"'"'s side, 400 ms allowed\n", n, worst; exit !(n >= 10 && worst <= 400)}' /tmp/line && lamps_dark
}

camera_on() {
    $world camera --video /dev/video10 --width 333 --height 333 --period 200 >/dev/null 2>&1 &
    camera_pid=$!
}

line_busy() {
    camera_on
    systemctl stop hordd || return 1
    gpioset -m signal rig-gpio 0=0 >/dev/null 2>&1 &
    local holder=$!
    sleep 0.5
    systemctl start --no-block hordd
    wait_for 120 journal_says 'COLLIMATOR_A.*holds it' || { kill $holder; return 1; }
    journalctl -u hordd -o cat | grep 'holds it' | tail -n 1
    kill $holder
    wait $holder 2>/dev/null
    wait_for 120 hordd_active || return 1  # by itself
    kill $camera_pid
}

chip_missing() {
    camera_on
    systemctl stop hordd || return 1
    echo 0 >$chip/live
    systemctl start --no-block hordd
    wait_for 120 journal_says 'there is no such chip' || return 1
    journalctl -u hordd -o cat | grep 'there is no such chip' | tail -n 1
    echo 1 >$chip/live
    wait_for 120 hordd_active || return 1
    kill $camera_pid
}

chip_goes() {
    start_world /tmp/goes --parts 1000 || return 1
    to_execution || return 1
    stop_world
    start_world /tmp/goes --parts 1000 || return 1
    to_execution || return 1
    local began
    began=$(now_ms)
    echo 0 >$chip/live
    wait_for 30 not_executing || return 1
    echo "line stopped $(($(now_ms) - began)) ms after the chip went"
    systemctl show -P StatusText hordd
    stop_world
    echo 1 >$chip/live
    start_world /tmp/back --parts 2 || return 1
    to_execution || return 1
    wait $world_pid || { cat /tmp/back; return 1; }
    grep totals /tmp/back | cut -d' ' -f2-
}

permit_down() { awk -v at="$2" '$2 == "coil" && $3 == 1 {down = $1 > at && $4 == 0} END {exit !down}' "$1"; }

# SIGKILL at random moments: when were lights dark and coils at rest after it?
killed() {
    local k pid at worst_light=0 worst_coil=0 light coil
    for k in $(seq "${kills:-3}"); do
        start_world /tmp/kill --parts 1000 --seed "$k" || return 1
        to_execution || { stop_world; return 1; }
        sleep "$((2 + RANDOM % 4)).$((RANDOM % 10))$((RANDOM % 10))"
        pid=$(systemctl show -P MainPID hordd)
        at=$(cut -d' ' -f1 /proc/uptime)
        kill -KILL "$pid"
        wait_for 2 lamps_dark || { echo "a light is on after kill $k"; return 1; }
        wait_for 60 permit_down /tmp/kill "$at" || return 1
        # The last change to dark, and of a coil to 0, after the kill; 0 where nothing had to change.
        light=$(awk -v at="$at" '$2 == "lamps" {if ($1 < at) was = $3; else if (was != 0) {print int(($1 - at) * 1000); was = 0}}' /tmp/kill | head -n 1)
        coil=$(awk -v at="$at" '$2 == "coil" && $3 == 1 {if ($1 < at) was = $4; else if (was != 0) {print int(($1 - at) * 1000); was = 0}}' /tmp/kill | head -n 1)
        echo "kill $k: dark after ${light:-0} ms, run permit down after ${coil:-never} ms"
        [ -n "$coil" ] || { cat /tmp/kill | tail; return 1; }
        [ "${light:-0}" -le $worst_light ] || worst_light=$light
        [ "$coil" -le $worst_coil ] || worst_coil=$coil
        wait_for 120 hordd_active || return 1
        stop_world
    done
    echo "${kills:-3} kills: dark within $worst_light ms, outputs safe within $worst_coil ms"
}

acknowledged_some() { [ "$(grep -c acknowledged /tmp/plc)" -ge 4 ]; }

# Parts run and a PLC acknowledges; then the host takes the power away, in the middle of it.
until_power_cut() {
    start_world /tmp/cut --parts 1000 || return 1
    to_execution || return 1
    $world plc >/tmp/plc 2>&1 &
    wait_for 60 acknowledged_some || { systemctl show -P StatusText hordd; return 1; }
    say CUT "now, in the middle of it"
    while sleep 0.05; do
        tail -n 1 /tmp/plc >/tmp/plc.last
        cmp -s /tmp/plc.last /tmp/plc.told || { cp /tmp/plc.last /tmp/plc.told; say ACKNOWLEDGED "$(cut -d' ' -f3- /tmp/plc.told)"; }
    done
}

# -- after the power cut ----------------------------------------------------------------------------------------

boot_into_ready() {
    wait_for 120 hordd_active || { journalctl -u hordd -o cat | tail; return 1; }
    local inactive active
    inactive=$(systemctl show -P InactiveExitTimestampMonotonic hordd)
    active=$(systemctl show -P ActiveEnterTimestampMonotonic hordd)
    echo "started by systemd at $((inactive / 1000)) ms after the kernel, ready $(((active - inactive) / 1000)) ms later; restarts: $(systemctl show -P NRestarts hordd)"
    systemctl show -P StatusText hordd
}

line_stopped() { systemctl show -P StatusText hordd | grep -q 'LINE STOP'; }

# Parts were on the line when the power went: nobody knows where they are.
line_stop_until_reset() {
    wait_for 60 line_stopped || { systemctl show -P StatusText hordd; return 1; }
    systemctl show -P StatusText hordd
    systemctl stop rig-camera
    start_world /tmp/again --parts 1000 || return 1
    to_execution || return 1
    stop_world
}

store_is_whole() {
    local boot sequence
    hordctl results verify || return 1
    read -r boot sequence <<<"$(sed -n 's/.*rig\.kept=\([0-9]*\)\.\([0-9]*\).*/\1 \2/p' /proc/cmdline)"
    [ -n "$sequence" ] || { echo "nothing was acknowledged before the cut"; return 1; }
    hordctl results --format json >/tmp/kept
    local kept
    kept=$(grep -c "\"boot\":$boot,\"sequence\":" /tmp/kept)
    echo "acknowledged before the cut: $sequence of boot $boot; kept of that boot: $kept"
    local k
    for k in $(seq "$sequence"); do grep -q "\"boot\":$boot,\"sequence\":$k," /tmp/kept || { echo "result $k is lost"; return 1; }; done
}

restart_time() {
    local k times=()
    camera_on
    for k in 1 2 3; do
        systemctl restart hordd || return 1
        times+=($((($(systemctl show -P ActiveEnterTimestampMonotonic hordd) - $(systemctl show -P InactiveExitTimestampMonotonic hordd)) / 1000)))
    done
    kill $camera_pid
    echo "start to ready, warm: ${times[*]} ms"
}

say START "$phase, $(cut -d' ' -f1 /proc/uptime) s after the kernel"
case $phase in
    install)
        check devices devices
        export HORD_GPIO_SIM=$chip
        check contract-strobe-gpio contract 'Gpio/StrobeContract.*/chip'
        check contract-part-sensor-gpio contract 'Gpio/PartSensorContract.*/chip*'
        check contract-sensor-v4l2loopback contract_video_loopback
        check contract-sensor-vivid contract_video_vivid
        check contract-rejector-modbus contract 'ModbusRejector/*'
        check contract-event-loop contract 'SdEventLoop/*'
        check package-installs-and-starts install_package
        check service-is-shut-in security
        check whole-line-with-the-world-below whole_line
        check lights-within-their-limits lights_in_limits
        check fault-line-busy line_busy
        check fault-chip-missing-at-start chip_missing
        check fault-chip-goes-and-returns chip_goes
        check fault-service-killed killed
        check fault-power-cut until_power_cut  # does not come back
        ;;
    cut)
        check power-cut-loses-nothing-acknowledged store_is_whole
        check fault-power-cut until_power_cut
        ;;
    boot)
        check boot-into-ready boot_into_ready
        check power-cut-loses-nothing-acknowledged store_is_whole
        check power-cut-stops-the-line-until-reset line_stop_until_reset
        check start-time restart_time
        ;;
esac
journalctl -b -o short-monotonic --no-hostname >/journal.txt 2>/dev/null
journalctl -b -u hordd -o short-monotonic --no-hostname | tail -n 40 | sed 's/^/RIG  # /'
say RESULT "pass=$pass fail=$fail"
sync
exit 0
