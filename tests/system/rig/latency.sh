#!/bin/bash
# Writes docs/results/rig-latency.md from the log of the machine (./dev rig latency): latency.sh LOG.rig SHIFT EDGES.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
log=$1 shift=$2 edges=$3 page=docs/results/rig-latency.md
grep -q '^RIG PASS latency-on-device-nodes' "$log" || { echo "rig: the latency was not measured: see $log" >&2; exit 1; }
said=$(sed -n 's/^RIG  | LATENCY //p' "$log" | grep -vE ': [0-9]+ %$')
{
    cat <<TXT
# Edge to light, edge to reject command, on device nodes

Made by \`HORD_RIG_EDGES=$edges ./dev rig latency\`: \`hordctl latency --config tests/system/rig/guest/latency.toml --sensor --actuate --edges $edges\` inside the rig's machine.
Run on $(date -u +%F) at commit $(git rev-parse --short=8 HEAD). Nothing in it is random.

The time is virtual: one processor executes one instruction in $((1 << shift)) ns, independent of the load of the host. It models no cache, no
pipeline and no other hardware. The numbers therefore count the instructions on the way, those of the kernel and of thread switches included. They
are not times of a real board. Every edge waits 50 us until the line is quiet (debounce); the rows that begin with an edge contain it.
On the way are: the simulated chip's interrupt, the kernel's line event, the driver, the line's output ioctl; libmodbus, the kernel's TCP on
loopback, and the module, which is another process of the same machine. Debian's kernel is not fully preemptible.

| | measured | missed | p50, us | p99, us | max, us |
|---|---|---|---|---|---|
TXT
    sed -nE 's/^(.*): ([0-9]+) measured, ([0-9]+) missed; p50 ([0-9]+) us, p99 ([0-9]+) us, .*max ([0-9]+) us$/| \1 | \2 | \3 | \4 | \5 | \6 |/p' <<<"$said"
    printf '\nAs it was printed:\n\n```\n%s\n```\n' "$said"
} >"$page"
sed -n '/^| /p' "$page"
echo "$page"
