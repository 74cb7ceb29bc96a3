#!/bin/bash
# Runs inside the machine. Every check prints "RIG PASS|FAIL name milliseconds"; its own output comes before that, behind "RIG  | ".
# `rig.phase` on the kernel's command line: install (first boot, ends in a power cut), boot (after it), time (in virtual time: one processor
# that executes one instruction per nanosecond, independent of the host's load), latency (as time, but only the package and the measurement).
set -u
chip=/sys/kernel/config/gpio-sim/rig
world=/opt/rig/hord_rig_world
phase=$(sed -n 's/.*rig\.phase=\([a-z]*\).*/\1/p' /proc/cmdline)
kills=$(sed -n 's/.*rig\.kills=\([0-9]*\).*/\1/p' /proc/cmdline)
seed=$(sed -n 's/.*rig\.seed=\([0-9]*\).*/\1/p' /proc/cmdline)
edges_asked=$(sed -n 's/.*rig\.edges=\([0-9]*\).*/\1/p' /proc/cmdline)
only=$(sed -n 's/.*rig\.only=\([^ ]*\).*/\1/p' /proc/cmdline)  # a pattern: only checks of these names
RANDOM=${seed:-1}
pass=0 fail=0
say() { printf 'RIG %s\n' "$*"; }
now_ms() {  # into `now`; starts no program: that takes an emulated processor longer than the intervals measured
    local up
    read -r up _ </proc/uptime
    now=$((10#${up/./} * 10))
}
mkfifo /run/rig-never
exec 9<>/run/rig-never
pause() { read -rt "$1" -u 9 || true; }  # s; a read that always times out

# check NAME COMMAND...: prints the command's output as it comes. The command is its own process group: after LIMIT (s of the machine's time) it is
# killed and has failed; when it ends, the processes that it has left running are killed.
limit=900
check() {
    local name=$1 now began group teller watch rc
    shift
    [[ $name =~ ${only:-.} ]] || return 0
    say BEGIN "$name"
    now_ms
    began=$now
    rm -f /run/rig-said /run/rig-over
    mkfifo /run/rig-said
    sed -u 's/^/RIG  | /' </run/rig-said &
    teller=$!
    set -m  # a group for each of the two
    "$@" </dev/null >/run/rig-said 2>&1 &
    group=$!
    end_when_over "$group" >/run/rig-said 2>&1 &
    watch=$!
    set +m
    wait "$group" 2>/dev/null
    rc=$?
    kill -KILL -- "-$watch" 2>/dev/null
    kill -KILL -- "-$group" 2>/dev/null
    wait "$teller" "$watch" 2>/dev/null
    [ ! -e /run/rig-over ] || rc=over
    now_ms
    if [ "$rc" = 0 ]; then pass=$((pass + 1)); say PASS "$name" "$((now - began))"; else fail=$((fail + 1)); say FAIL "$name" "$((now - began))"; fi
}

end_when_over() {  # end_when_over GROUP: at the time limit, prints the state of the group and kills it
    sleep "$limit"
    touch /run/rig-over
    echo "not at its end after $limit s; what of it still runs:"
    ps -eo pgid,pid,etimes,stat,wchan:24,args | awk -v group="$1" '$1 == group'
    systemctl show -P StatusText hordd
    kill -KILL -- "-$1"
}

wait_for() {  # wait_for SECONDS COMMAND...: polls at growing intervals, because every poll starts programs
    local now until between=1
    now_ms
    until=$((now + $1 * 1000))
    shift
    until "$@" >/dev/null 2>&1; do
        now_ms
        [ "$now" -lt "$until" ] || { echo "waited in vain for: $*"; return 1; }
        pause "0.$between"
        [ $between -ge 8 ] || between=$((2 * between))
    done
}

# -- the seam ---------------------------------------------------------------------------------------------------

# contract FILTER: a suite of tests/system/contract on a real device; no test may be skipped.
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

# What hordctl devices finds while the station holds its lights and another program a camera, which goes on.
devices_listed() {
    camera_on
    systemctl restart --no-block hordd
    wait_for 300 systemctl is-active hordd || { systemctl status hordd | tail; return 1; }
    v4l2-ctl -d /dev/video20 --stream-mmap --stream-count=100000 >/dev/null 2>&1 &
    local streaming=$!
    pause 2
    hordctl devices >/tmp/listed || return 1
    cut -c1-150 /tmp/listed
    local text
    for text in ': "rig-gpio", 16 lines' 'COLLIMATOR_A, output, in use by hord' 'line   4 SPARE' '/dev/video10: rigcam' \
        'in use by v4l2-ctl (process ' 'format GREY (8 bits)' '/dev/video20: vivid' 'vimc.0 Sensor B'; do
        grep -qF "$text" /tmp/listed || { echo "not listed: $text"; return 1; }
    done
    kill -0 $streaming && systemctl is-active hordd
}

contract_video_loopback() {
    $world camera --video /dev/video11 >/dev/null 2>&1 &
    local camera=$!
    sleep 1
    # The loss of a device is tested on the other device: this one is never lost.
    HORD_V4L2_DEVICE=/dev/video11 contract 'V4l2/*-*a_loss_is_told_once*'
    local rc=$?
    kill $camera
    wait $camera 2>/dev/null
    return $rc
}
contract_video_vivid() {
    v4l2-ctl -d /dev/video20 -v width=320,height=180,pixelformat=GREY -p 5 >/dev/null 2>&1
    v4l2-ctl -d /dev/video20 -c timestamp_source=1  # time stamp of the frame's start: that of its end lies in the future
    HORD_V4L2_LOSE='v4l2-ctl -d /dev/video20 -c inject_fatal_streaming_error=1' HORD_V4L2_DEVICE=/dev/video20 contract 'V4l2/*'
}

# libcamera's vimc pipeline on the kernel's vimc; unbinding it from its driver removes the camera.
contract_libcamera() {
    local driver=/sys/bus/platform/drivers/vimc
    HORD_LIBCAMERA=any HORD_LIBCAMERA_LOSE="echo vimc.0 >$driver/unbind" HORD_LIBCAMERA_RETURN="echo vimc.0 >$driver/bind" contract 'Libcamera/*/camera'
}

# -- the installed station --------------------------------------------------------------------------------------

# From the status that the service sends to systemd: a Modbus request starts a program, which takes seconds on an emulated processor.
executes() { [[ $(systemctl show -P StatusText hordd) = ContinuousExecution* ]]; }
not_executing() { ! executes; }
hordd_active() { [ "$(systemctl is-active hordd)" = active ]; }
journal_says() { grep -q "$1" /run/hordd.log; }
follow_journal() {  # from now on
    [ -z "${follower:-}" ] || kill "$follower"
    journalctl -fu hordd -o cat -n 0 >/run/hordd.log 2>&1 &
    follower=$!
}
lamps_dark() { [ "$(cat "$(line_folder 0)/value")$(cat "$(line_folder 1)/value")" = 00 ]; }
line_is_used() { gpioinfo rig-gpio | grep 'COLLIMATOR_A.*used'; }
line_folder() { echo "/sys/devices/platform/$(cat $chip/dev_name)/$(cat $chip/bank0/chip_name)/sim_gpio$1"; }

# The package's files and installation steps without dpkg, for machines that do not test the installation: dpkg takes an emulated processor a
# minute. As after dpkg, the files outlive a power cut and the station starts at the next boot.
station_is_there() {
    [ ! -e /usr/bin/hordd ] || return
    dpkg-deb --fsys-tarfile /opt/rig/hord-station.deb | tar -x --keep-directory-symlink -C /
    cp /opt/rig/hordd.toml /etc/hord/hordd.toml
    systemd-sysusers hord.conf
    systemctl daemon-reload
    udevadm control --reload
    udevadm trigger --subsystem-match=gpio
    systemctl enable --quiet hordd.socket hordd
    sync
    systemctl start hordd.socket
    systemctl start --no-block hordd
    say "# the package is there $(cut -d' ' -f1 /proc/uptime) s after the kernel"
}

install_package() {
    mkdir -p /etc/hord
    start_world /tmp/install --parts 1000 || return 1  # the camera is on, the module answers
    cp /opt/rig/hordd.toml /etc/hord/hordd.toml  # kept: the package does not overwrite an edited configuration
    dpkg -i --force-confold /opt/rig/hord-station.deb || return 1
    cmp /opt/rig/hordd.toml /etc/hord/hordd.toml || return 1
    wait_for 120 hordd_active || { systemctl status hordd --no-pager; journalctl -u hordd -o cat | tail -n 20; return 1; }
    systemctl show -P StatusText hordd
    ls -l /dev/gpiochip* /dev/video10
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

# Afterwards the station executes: by itself, or after a reset.
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

# Light and output while the line ran: never longer than the channel's limit; afterwards dark and at rest.
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
    wait_for 30 line_is_used || return 1
    follow_journal
    systemctl start --no-block hordd
    wait_for 120 journal_says 'COLLIMATOR_A.*holds it' || { kill $holder; return 1; }
    grep 'holds it' /run/hordd.log | tail -n 1
    kill $holder
    wait $holder 2>/dev/null
    wait_for 120 hordd_active || return 1  # by itself
    kill $camera_pid
}

chip_missing() {
    camera_on
    systemctl stop hordd || return 1
    echo 0 >$chip/live
    follow_journal
    systemctl start --no-block hordd
    wait_for 120 journal_says 'there is no such chip' || return 1
    grep 'there is no such chip' /run/hordd.log | tail -n 1
    echo 1 >$chip/live
    wait_for 120 hordd_active || return 1
    kill $camera_pid
}

chip_goes() {
    start_world /tmp/goes --person 127.0.0.1:502 --parts 1000 || return 1
    to_execution || return 1
    local now began
    now_ms
    began=$now
    echo 0 >$chip/live
    wait_for 30 not_executing || return 1
    now_ms
    echo "seen to have stopped $((now - began)) ms after the chip went"
    systemctl show -P StatusText hordd
    stop_world
    echo 1 >$chip/live
    start_world /tmp/back --person 127.0.0.1:502 --parts 2 || return 1
    to_execution || return 1
    wait $world_pid || { cat /tmp/back; return 1; }
    grep -E ' (totals|resets) ' /tmp/back | cut -d' ' -f2-
}

# A camera that only libcamera supports, in the installed service; it is removed and comes back.
libcamera_disconnect() {
    cp /etc/hord/hordd.toml /tmp/hordd.toml
    sed -i 's|^backend = "v4l2"|backend = "libcamera"\ngreen = true|; s|^width_px = .*|width_px = 90|; s|^height_px = .*|height_px = 90|; /^device = /d' /etc/hord/hordd.toml
    start_world /tmp/libcamera --parts 1000 --person 127.0.0.1:502 || return 1
    follow_journal
    systemctl restart --no-block hordd
    local rc=0
    libcamera_goes || rc=1
    stop_world
    cp /tmp/hordd.toml /etc/hord/hordd.toml
    systemctl restart --no-block hordd
    return $rc
}
# This process has inspected its camera's frames. They are a test pattern: unfit, for its period.
has_judged() { hordctl status --json | grep -q '"inspected":[1-9]'; }
libcamera_goes() {
    wait_for 120 executes || { tail -n 5 /run/hordd.log; return 1; }
    wait_for 120 has_judged || { systemctl show -P StatusText hordd; hordctl results --format csv --last 5 | cut -d, -f5-8; return 1; }
    local now began
    now_ms
    began=$now
    local process
    process=$(systemctl show -P MainPID hordd)
    echo vimc.0 >/sys/bus/platform/drivers/vimc/unbind
    wait_for 60 not_executing || return 1
    now_ms
    echo "seen to have stopped $((now - began)) ms after the camera went"
    systemctl show -P StatusText hordd
    echo vimc.0 >/sys/bus/platform/drivers/vimc/bind
    wait_for 120 executes || { tail -n 5 /run/hordd.log; return 1; }
    echo "executes again; the station's process was $process, is $(systemctl show -P MainPID hordd)"
    [ "$process" = "$(systemctl show -P MainPID hordd)" ]  # it has not been started again
}

# A GigE camera in the installed service: Aravis's fake camera as a process of its own, over loopback. It is switched off and on again.
start_gige() {
    /opt/rig/hord_fake_gige 127.0.0.1 S1 /opt/rig/frames/good.pgm >/tmp/gige 2>&1 &
    gige_pid=$!
    wait_for 60 grep -q ready /tmp/gige || { cat /tmp/gige; return 1; }
}
stop_gige() {
    kill -KILL "$gige_pid"
    wait "$gige_pid" 2>/dev/null
    return 0
}
genicam_disconnect() {
    cp /etc/hord/hordd.toml /tmp/hordd.toml
    sed -i 's|^backend = "v4l2"|backend = "genicam"\ncamera = "S1"\ntrigger = "software"|; /^device = /d' /etc/hord/hordd.toml
    install -D -m644 /opt/rig/genicam.conf /etc/systemd/system/hordd.service.d/genicam.conf
    systemctl daemon-reload
    start_gige || return 1
    start_world /tmp/genicam --parts 1000 --person 127.0.0.1:502 || return 1
    follow_journal
    systemctl restart --no-block hordd
    local rc=0
    genicam_goes || { rc=1; tail -n 12 /run/hordd.log; systemctl show -P StatusText hordd; }
    stop_world
    stop_gige
    cp /tmp/hordd.toml /etc/hord/hordd.toml
    rm /etc/systemd/system/hordd.service.d/genicam.conf
    systemctl daemon-reload
    systemctl restart --no-block hordd
    return $rc
}
# A part of after $since was judged good: the fake camera's frames are of good parts.
has_passed() { [ "$(hordctl results --since "$since" --verdict pass --format csv | tail -n +2 | wc -l)" -gt 0 ]; }
genicam_goes() {
    local now began process since
    wait_for 120 journal_says 'S1: 333 x 333 Mono8' || return 1
    wait_for 120 executes || return 1
    since=$(date -u +%FT%T)
    wait_for 120 has_passed || { hordctl results --format csv --last 5 | cut -d, -f5-8; return 1; }
    process=$(systemctl show -P MainPID hordd)
    now_ms
    began=$now
    stop_gige
    wait_for 60 not_executing || return 1
    now_ms
    echo "seen to have stopped $((now - began)) ms after the camera was switched off"
    start_gige || return 1
    wait_for 120 executes || return 1
    echo "executes again; the station's process was $process, is $(systemctl show -P MainPID hordd)"
    [ "$process" = "$(systemctl show -P MainPID hordd)" ]  # it has not been started again
}

# -- in virtual time --------------------------------------------------------------------------------------------

# Edges of the light barrier that belong to no part: an object close behind a part, and edges that the kernel has lost. The person clears the
# belt and resets the station after the stop.
edges_wrong() {
    start_world /tmp/edges --person 127.0.0.1:502 --parts 14 --seed "${seed:-1}" --patience 400 --faults '3=too-close,8=edges-lost' || return 1
    to_execution || return 1
    wait $world_pid
    local rc=$?
    grep -E ' (gone|totals|resets|edges|edges-lost:) ' /tmp/edges | cut -d' ' -f2-
    hordctl results --format csv --last 16 | cut -d, -f5-7 | tee /tmp/edges-results
    [ $rc = 0 ] || return 1
    # Both, the part and the object behind it, are reported as too close.
    [ "$(cut -d, -f3 /tmp/edges-results | grep -c parts-too-close)" = 2 ]
}

# Each fault of the module at some command; the person clears the belt and resets the station after each stop.
rejector_faults() {
    start_world /tmp/module --person 127.0.0.1:502 --parts 38 --good-share 0 --seed "${seed:-1}" --patience 400 \
        --faults '2=reject-refused,8=reject-late,14=reject-drip,20=reject-close,26=reject-stuck,32=module-reboot' || return 1
    sed -i 's/^response_timeout_ms = .*/response_timeout_ms = 100/' /etc/hord/hordd.toml  # this processor comes in time
    systemctl restart --no-block hordd
    wait $world_pid
    local rc=$?
    grep -E ' (module-fault|totals|resets|a fault|kill) ' /tmp/module | cut -d' ' -f2-
    hordctl status 2>/dev/null | grep -iE 'reject|fault' | head -n 5
    return $rc
}

# The module behind two of the machine's UARTs that are wired to each other, with noise on the wire for a while.
serial_noise() {
    local ports
    mapfile -t ports < <(ls -d /sys/bus/pci/drivers/serial/*/tty/ttyS* | sed 's|.*/||')
    [ ${#ports[@]} = 2 ] || { echo "two serial ports are expected, there are: ${ports[*]}"; return 1; }
    cp /etc/hord/hordd.toml /tmp/hordd.toml
    sed -i "s|^port = 1503|device = \"/dev/${ports[0]}\"\nrs485 = false|" /etc/hord/hordd.toml
    start_world /tmp/serial --person 127.0.0.1:502 --serial "/dev/${ports[1]}" --parts 20 --seed "${seed:-1}" --patience 400 --faults '6=noise' || return 1
    systemctl restart --no-block hordd
    wait $world_pid
    local rc=$?
    grep -E ' (gone|totals|resets|disturbed|a fault) ' /tmp/serial | cut -d' ' -f2- | tail -n 30
    cp /tmp/hordd.toml /etc/hord/hordd.toml
    systemctl restart --no-block hordd  # waits for its camera, which comes with the next world
    return $rc
}

# SIGKILL at random moments in each phase of a part's way: measures the time until lights are dark and outputs at rest. Every part is bad, so that
# the ejector is out as often as possible.
killed() {
    start_world /tmp/kill --parts 0 --good-share 0 --person 127.0.0.1:502 --seed "${seed:-1}" --kills "${kills:-6}" --safe-ms 500 --patience 7200 || return 1
    # Printed as they come, so that an aborted run shows its progress.
    tail -n +1 -f /tmp/kill --pid=$world_pid | grep --line-buffered -E ' kills? ' | sed -u 's/^[^ ]* //'
    wait $world_pid
    local rc=$?
    [ $rc = 0 ] || tail -n 5 /tmp/kill
    return $rc
}

# -- drills: docs/reliability.md has the table of what must happen

# Parts pass while DRILL runs; without a person who resets, so that every stop of the line is a failure.
line_goes_on() {  # line_goes_on DRILL [ARGUMENT...]
    local drill=$1 rc
    shift
    start_world /tmp/drill --parts 8 --seed "${seed:-1}" --patience 400 "$@" || return 1
    to_execution && "$drill" || { stop_world; return 1; }
    wait $world_pid
    rc=$?
    grep -E ' (totals|resets) ' /tmp/drill | cut -d' ' -f2-
    systemctl show -P StatusText hordd
    return $rc
}
results_are_whole() { hordctl results verify | grep 'every row is as it was written'; }

# The wall clock is two years ahead, then two behind: the line goes on, and nothing is deleted.
steps_of_the_clock() {
    local step
    for step in '2 years' '4 years ago' '2 years'; do
        date -s "$step"
        pause 12
    done
}
clock_steps() {
    local before after
    before=$(hordctl results --format csv | wc -l)
    line_goes_on steps_of_the_clock || return 1
    after=$(hordctl results --format csv | wc -l)
    echo "results before: $((before - 1)), after: $((after - 1))"
    [ "$after" -ge $((before + 8)) ] && results_are_whole
}

short_stalls() {
    local s
    for s in 0.02 0.05 0.1 0.2; do
        systemctl kill -s STOP hordd
        pause $s
        systemctl kill -s CONT hordd
        pause 5
    done
}
# A short stall changes nothing. After a longer one parts may be unfit, or the line may stop. A bad part may have passed
# only if the station says so: LINE STOP until a person has cleared the belt. A good part is ejected only if it is told as
# unfit.
stalled() {
    line_goes_on short_stalls || return 1
    follow_journal
    held_up_by stop_and_continue
}
stop_and_continue() { systemctl kill -s STOP hordd; pause "$1"; systemctl kill -s CONT hordd; }
starve() { timeout "$1" chrt -f 60 sh -c 'while :; do :; done'; }
held_up_by() {  # held_up_by COMMAND: for 0.5, 2 and 5 s
    local s since stops bad good unjudged
    for s in 0.5 2 5; do
        since=$(date -u +%FT%T)
        start_world /tmp/held --parts 1000 --seed "${seed:-1}" --person 127.0.0.1:502 || return 1
        to_execution || { stop_world; return 1; }
        pause 20
        "$1" $s
        pause 20
        stop_world
        stops=$(grep -c 'kFaultRejectUnconfirmed\|reject-unconfirmed' /run/hordd.log)
        bad=$(grep -c 'left WRONG' /tmp/held)
        good=$(grep -c 'ejected WRONG' /tmp/held)
        unjudged=$(hordctl results --since "$since" --verdict unfit --format csv | tail -n +2 | wc -l)
        echo "$1 $s s: bad parts that passed $bad, good parts ejected $good, parts told as unfit $unjudged, line stops so far $stops"
        [ "$bad" = 0 ] || [ "$stops" -gt 0 ] || { echo "a part passed, and the station did not say so"; return 1; }
        [ "$good" -le "$unjudged" ] || { echo "a good part was ejected, and the station did not say so"; return 1; }
    done
    hordd_active
}
starved() {
    follow_journal
    held_up_by starve
}

# The kernel's out-of-memory killer takes each process beside the station's.
out_of_memory() {  # out_of_memory PID
    choom -n 1000 -p "$1" >/dev/null
    echo f >/proc/sysrq-trigger
    wait_for 20 eval "! kill -0 $1"
}
others_out_of_memory() {
    local unit
    for unit in hord-page hord-mqtt systemd-journald; do
        out_of_memory "$(systemctl show -P MainPID $unit)" || { echo "$unit was not killed"; return 1; }
        wait_for 60 systemctl is-active $unit || return 1
        echo "$unit was killed, and is there again"
    done
}
memory_runs_out() {
    local process
    systemctl start hord-page hord-mqtt || return 1
    process=$(systemctl show -P MainPID hordd)
    line_goes_on others_out_of_memory || return 1
    systemctl stop hord-page hord-mqtt
    [ "$process" = "$(systemctl show -P MainPID hordd)" ]  # it has not been started again
}

# The state folder on a small disk of its own, behind device-mapper: it can be filled and broken.
state_sectors=$((32 * 2048))  # of 512 bytes
state_disk() {
    ! mountpoint -q /var/lib/hord || return 0
    systemctl stop hordd
    truncate -s 32M /run/state.img
    modprobe -a loop dm-mod
    dmsetup create state --table "0 $state_sectors linear $(losetup --show -f /run/state.img) 0" || return 1
    mkfs.ext4 -q -N 512 /dev/mapper/state || return 1
    mount -o errors=remount-ro /dev/mapper/state /var/lib/hord || return 1
    chown hord:hord /var/lib/hord
    systemctl start --no-block hordd
}
store_fault() { systemctl show -P StatusText hordd | grep -q 'faults:.*store'; }
no_store_fault() { ! store_fault; }
fill_the_disk() {
    cat /dev/zero >/var/lib/hord/fill 2>/dev/null
    wait_for 60 store_fault || return 1
    rm /var/lib/hord/fill
    wait_for 90 no_store_fault
}
disk_full() {
    state_disk || return 1
    line_goes_on fill_the_disk || return 1
    [ "$(hordctl results --format csv | wc -l)" -ge 9 ] && results_are_whole
}
# The service is started with a camera, without a module: Initialized, and nothing moves on the line. An orderly end proves that the line
# is empty.
restart_without_parts() {
    systemctl restart hordd && wait_for 120 hordd_active && pause 5
}
empty_line() {  # a person has looked
    restart_without_parts && { not_stopped || hordctl command reset; } && wait_for 30 not_stopped
}
not_stopped() { ! line_stopped; }
# Without inodes the proof of an empty line cannot be written: the next start must not take the line for empty.
no_inodes() {
    local k rc=0
    state_disk || return 1
    camera_on
    empty_line && restart_without_parts && not_stopped || { echo "line stop after an orderly end"; return 1; }
    for k in $(seq 600); do : >"/var/lib/hord/$k" || break; done 2>/dev/null
    restart_without_parts && wait_for 60 line_stopped || rc=1
    rm -f /var/lib/hord/[0-9]*
    kill $camera_pid
    return $rc
}
broken_disk() {
    dmsetup suspend state
    dmsetup load state --table "0 $state_sectors error"
    dmsetup resume state
    pause 30
}
mended_disk() {
    dmsetup suspend state
    dmsetup load state --table "0 $state_sectors linear $(losetup -n -O NAME -j /run/state.img) 0"
    dmsetup resume state
    e2fsck -p /dev/mapper/state
    mount /dev/mapper/state /var/lib/hord
}
# EIO, and from then on a read-only file system: the line goes on; after a crash it does not run before a person has reset it.
disk_dies() {
    state_disk || return 1
    line_goes_on broken_disk || return 1
    camera_on
    systemctl kill -s KILL hordd
    pause 20
    not_executing || return 1
    systemctl stop hordd
    umount -l /var/lib/hord
    mended_disk || return 1
    systemctl start --no-block hordd
    wait_for 120 line_stopped || { systemctl show -P StatusText hordd; return 1; }
    kill $camera_pid
}
# A proof that cannot be withdrawn would hold for a later crash, too: the line does not run.
read_only_state() {
    camera_on
    empty_line && systemctl stop hordd || return 1
    kill $camera_pid
    [ -e /var/lib/hord/line-empty ] || { echo "no proof after an orderly end with an empty line"; return 1; }
    mount --bind /var/lib/hord /var/lib/hord
    mount -o remount,bind,ro /var/lib/hord
    follow_journal
    start_world /tmp/read-only --parts 1000 || return 1
    systemctl start --no-block hordd
    wait_for 60 line_stopped || return 1
    hordctl command reset 2>&1
    pause 10
    not_executing || { echo "it runs although the proof is still there"; return 1; }
    grep -m 1 'line-empty cannot be removed' /run/hordd.log || return 1
    systemctl stop hordd
    umount /var/lib/hord
    systemctl start --no-block hordd
    to_execution || return 1
    stop_world
}

latency() {
    systemctl stop hordd hordd.socket
    $world edges --chip $chip >/tmp/edges 2>&1 &
    local edges=$!
    wait_for 60 grep -q ' ready' /tmp/edges || { cat /tmp/edges; return 1; }
    hordctl latency --config /opt/rig/latency.toml --sensor --actuate --edges "${edges_asked:-300}" </dev/null >/tmp/latency 2>&1
    local rc=$?
    grep -vE ': [0-9]+ %$' /tmp/latency | sed 's/^/LATENCY /'
    kill $edges
    return $rc
}

acknowledged_some() { [ "$(grep -c acknowledged /tmp/plc)" -ge 4 ]; }

# Parts run and a PLC acknowledges; meanwhile the host cuts the power.
until_power_cut() {
    start_world /tmp/cut --parts 1000 || return 1
    to_execution || return 1
    $world plc >/tmp/plc 2>&1 &
    wait_for 60 acknowledged_some || { systemctl show -P StatusText hordd; return 1; }
    say CUT "in the middle of it, as soon as the host has heard what was acknowledged"
    # Directly to the console: the journal may not have written its lines before the power cut.
    tail -n 1 -f /tmp/plc | while read -r _ _ boot sequence; do echo "RIG ACKNOWLEDGED $boot $sequence"; done >/dev/console
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

# Parts were on the line at the power cut: their positions are unknown.
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
        check contract-sensor-libcamera-vimc contract_libcamera
        # own_module lives in the test's process: it cannot go away and come back.
        check contract-rejector-modbus contract 'ModbusRejector/*-*without_the_module*/own_module'
        check contract-event-loop contract 'SdEventLoop/*'
        check package-installs-and-starts install_package
        station_is_there
        check service-is-shut-in security
        check devices-are-listed devices_listed
        check fault-line-busy line_busy
        check fault-chip-missing-at-start chip_missing
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
    time)
        station_is_there
        check whole-line-with-the-world-below whole_line
        check lights-within-their-limits lights_in_limits
        check fault-chip-goes-and-returns chip_goes
        check fault-edges-too-close-or-lost edges_wrong
        check fault-rejector-misbehaves rejector_faults
        check fault-serial-noise serial_noise
        limit=$((900 + 30 * ${kills:-6}))
        check fault-service-killed killed
        limit=900
        check drill-clock-steps clock_steps
        check drill-stalled stalled
        check drill-starved starved
        check drill-others-out-of-memory memory_runs_out
        check drill-read-only-state read_only_state
        check drill-disk-full disk_full
        check drill-no-inodes no_inodes
        check drill-disk-dies disk_dies
        check latency-on-device-nodes latency
        check fault-libcamera-goes-and-returns libcamera_disconnect
        check fault-genicam-goes-and-returns genicam_disconnect
        ;;
    latency)
        station_is_there
        check latency-on-device-nodes latency
        ;;
esac
journalctl -b -o short-monotonic --no-hostname >/journal.txt 2>/dev/null
journalctl -b -u hordd -o short-monotonic --no-hostname | tail -n 40 | sed 's/^/RIG  # /'
say RESULT "pass=$pass fail=$fail"
sync
exit 0
