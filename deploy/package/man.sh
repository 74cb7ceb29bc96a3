#!/bin/bash
# Man pages from what the programs say of themselves: man.sh BINDIR OUTDIR VERSION. The pages are the same on every architecture.
set -euo pipefail
bin=$1 out=$2 version=$3

# Roff takes a backslash, a leading dot or a leading quote for its own.
roff() { sed -e 's/\\/\\e/g' -e "s/^\([.']\)/\\\\\&\1/" -e 's/-/\\-/g'; }

# What a command says of itself, and then each of its own commands: sections PROGRAM, COMMAND...
commands() {
    local sub
    "$bin/$1" "${@:2}" --help | sed -n '/^Subcommands:/,/^$/p' | sed -n 's/^  \([a-z][a-z0-9-]*\).*/\1/p' | while read -r sub; do
        printf '.SH "%s"\n.nf\n' "$(tr '[:lower:]' '[:upper:]' <<<"$* $sub")"
        "$bin/$1" "${@:2}" "$sub" --help | sed "s|^Usage: .*/$1|Usage: $1|" | roff
        printf '.fi\n'
        commands "$@" "$sub"
    done
}

page() {  # page PROGRAM SECTION ONE-LINE: the body comes from standard input
    local program=$1 section=$2 about=$3
    mkdir -p "$out/man$section"
    {
        printf '.TH %s %s "" "hord-station %s" "HORD station"\n' "${program^^}" "$section" "$version"
        printf '.SH NAME\n%s \\- %s\n' "${program//-/\\-}" "$about"
        cat
        printf '.SH FILES\n.nf\n/etc/hord/hordd.toml  configuration, every key with its default\n/etc/hord/recipes/  recipes\n/etc/hord/mqtt.toml  configuration of hord\-mqtt\n/etc/hord/page.toml  configuration of hord\-page\n'
        printf '/usr/share/doc/hord\\-station/plc.md  for the PLC programmer\n.fi\n.SH "SEE ALSO"\n.BR hordd (8),\n.BR hordctl (1),\n.BR hord\\-lab (1),\n.BR hord\\-mqtt (8),\n.BR hord\\-page (8),\n.BR hord\\-safe (8)\n'
    } | gzip -9n >"$out/man$section/$program.$section.gz"
}

program() {  # program PROGRAM SECTION ONE-LINE
    {
        printf '.SH SYNOPSIS\n.B %s\n[OPTIONS]\n.SH DESCRIPTION\n.nf\n' "${1//-/\\-}"
        "$bin/$1" --help | sed "s|^Usage: .*/$1|Usage: $1|" | roff
        printf '.fi\n'
        commands "$1"
    } | page "$@"
}

camera() {  # camera PROGRAM ONE-LINE LIBRARY: has no options, people do not start it
    page "$1" 8 "$2" <<TXT
.SH DESCRIPTION
The station starts this program for its camera, so that a fault in $3 cannot stop the station.
It has no options; started by hand it says so and ends with status 2.
The camera is chosen in [sensor] of the configuration.
TXT
}

program hordd 8 "inspection station for transparent parts, as a service"
program hordctl 1 "inspect, learn, run, watch and command an inspection station"
program hord-lab 1 "experiments, soak and scenes on the simulated inspection cell"
program hord-mqtt 8 "hands a station's results and health to an MQTT broker, as a service"
program hord-page 8 "the station's page for browsers, and metrics for Prometheus"
program hord-safe 8 "turns a station's lights off and brings its rejector to the safe state"
camera hord-camera "process of a station's libcamera camera" libcamera
camera hord-genicam "process of a station's GenICam camera" "Aravis or a camera's network"
