#!/bin/bash
# Counts the arm64 instructions of a verdict: count_instructions.sh DIR, where DIR is that of `hord-lab experiment
# whole` (its full form). Writes DIR/arm64/instructions.csv, which the next run of the experiment reports. Needs
# g++-aarch64-linux-gnu and qemu-user-static.
#
# qemu lists the instructions of each block that it translates (-d in_asm) and logs each block that runs (-d exec,nochain):
# the sum of their instructions is counted. A verdict's number is that of a run with two verdicts less that of a run with
# one, so the start of the program is not in it.
set -euo pipefail
folder=$(readlink -f "$1")/arm64
cd "$(dirname "$(readlink -f "$0")")/../../.."
program=$folder/inspect_frames
sources=()
for room in algo/emd algo/features algo/frame algo/inspection algo/light algo/maps algo/recipe algo/reference algo/simd algo/soa algo/verdict; do
    for file in "$room"/*.cpp; do [ -e "$file" ] && sources+=("$file"); done
done
objects=$folder/objects
mkdir -p "$objects"
compile() {  # SOURCE, if it is newer than its object
    local object=$objects/${1//\//_}.o
    [ "$object" -nt "$1" ] ||
        aarch64-linux-gnu-g++ -std=c++20 -O2 -ffp-contract=off -Wno-psabi -I. -Itests/bench/arm64 -c "$1" -o "$object"
}
export -f compile
export objects
printf '%s\n' tests/bench/arm64/inspect_frames.cpp "${sources[@]}" | xargs -P "${JOBS:-2}" -I{} bash -c 'compile {}'
aarch64-linux-gnu-g++ -static -pthread "$objects"/*.o -o "$program"

instructions() {  # FRAME LINE TIMES
    qemu-aarch64-static -d in_asm,exec,nochain "$program" "$folder/$1.raw" 111 "$folder/recipes.txt" "$2" "$3" 2>&1 >/dev/null | awk '
        /^Trace/ { split($4, at, "/"); pc = at[2]; sub(/^0+/, "", pc); total += size[pc]; next }
        /^IN:/ { first = 1; next }
        /^0x/ { if (first) { block = $1; gsub(/^0x0*|:$/, "", block); size[block] = 0; first = 0 } size[block]++ }
        END { printf "%d\n", total }'
}
line=0
while read -r _ _ _ _ _ _ _ name; do
    for frame in good bad; do
        one=$(instructions $frame $line 1) two=$(instructions $frame $line 2)
        echo "$frame;$((two - one));$name"
    done
    line=$((line + 1))
done <"$folder/recipes.txt" >"$folder/instructions.csv"
cat "$folder/instructions.csv"
