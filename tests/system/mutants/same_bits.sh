#!/usr/bin/env bash
# The same seed gives the same bits, however the soak is compiled: core, station, simulated cell and observer without optimisation
# against build/release, over one soak.
#
#     tests/system/mutants/same_bits.sh [PARTS]     (100,000; build/release must have mutant-none)
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
parts=${1:-100000}
objects=build/unoptimised
mkdir -p "$objects"
for file in firmware/core/*.cpp firmware/station/station.cpp lab/stand_in/stand_in_inspector.cpp hal_sim/cell/cell.cpp \
            hal_sim/world/{world,conveyor,fault_injection,frame_source}.cpp lab/virtual_time/virtual_time.cpp hal_sim/devices/*.cpp \
            lab/soak/{invariants,invariants_results,device_proxies,simulated_line,plan,ordered_stops,plc_simulator,store_observer,soak}.cpp; do
    echo "$file"
done | xargs -P "$(nproc)" -I FILE sh -c 'g++ -std=gnu++20 -O0 -ffp-contract=off -I. -c FILE -o '"$objects"'/$(echo FILE | tr / _).o'
libraries=$(grep -A14 '^build tests/system/mutants/mutant-none:' build/release/build.ninja | sed -n 's/.*LINK_LIBRARIES = //p')
(cd build/release && eval g++ ../unoptimised/*.o tests/system/mutants/CMakeFiles/hord_probe.dir/probe.cpp.o -o ../unoptimised/mutant-none "$libraries")
one=$(build/release/tests/system/mutants/mutant-none --parts "$parts")
other=$("$objects/mutant-none" --parts "$parts")
echo "-O2: $one"
echo "-O0: $other"
test "$one" = "$other"
