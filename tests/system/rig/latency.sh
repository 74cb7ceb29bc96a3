#!/bin/bash
# Makes docs/results/rig-latency.md of what the machine said (./dev rig latency): latency.sh LOG.rig SHIFT EDGES.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
log=$1 shift=$2 edges=$3 page=docs/results/rig-latency.md
grep -q '^RIG PASS latency-on-device-nodes' "$log" || { echo "rig: the latency was not measured: see $log" >&2; exit 1; }
said=$(sed -n 's/^RIG  | LATENCY //p' "$log" | grep -vE ': [0-9]+ %$')
{
    cat <<TXT
# Edge to light, edge to reject command, on device nodes

Made by \`HORD_RIG_EDGES=$edges ./dev rig latency\`: \`hordctl latency --config tests/system/rig/guest/latency.toml --sensor --actuate --edges $edges\` inside the rig's machine.

The time is virtual: one processor that does one instruction in $((1 << shift)) ns, whatever the host does meanwhile, with no cache, no pipeline and no other
hardware. So the numbers count the instructions on the way, kernel and switches of threads included; they are no times of a real board. Every edge
waits 50 us until the line has kept still (debounce), which is in the rows that begin with it.
What is on the way: the simulated chip's interrupt, the kernel's event of the line, the driver, the line's output ioctl; and libmodbus, the kernel's
TCP on loopback, a module that is another process of the same machine. Debian's kernel is not fully preemptible.

| | measured | missed | p50, us | p99, us | max, us |
|---|---|---|---|---|---|
TXT
    sed -nE 's/^(.*): ([0-9]+) measured, ([0-9]+) missed; p50 ([0-9]+) us, p99 ([0-9]+) us, .*max ([0-9]+) us$/| \1 | \2 | \3 | \4 | \5 | \6 |/p' <<<"$said"
    printf '\nAs it was printed:\n\n```\n%s\n```\n' "$said"
} >"$page"
sed -n '/^| /p' "$page"
echo "$page"
