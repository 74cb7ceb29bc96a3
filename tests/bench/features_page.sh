#!/usr/bin/env bash
# Makes docs/results/features.md, growth.csv and growth.png from the benchmarks: tests/bench/features_page.sh (after ./dev bench, or
# `cmake --build --preset release --target bench_emd bench_features bench_whole bench_growth`). Needs gnuplot.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
bin=build/release/bin out=docs/results/features.md
tables() { sed -n '/^$/,$p' | sed '1d'; }  # what a benchmark prints after Google Benchmark's own lines

emd=$("$bin/bench_emd" 2>/dev/null | tables)
features=$("$bin/bench_features" 2>/dev/null | tables)
whole=$("$bin/bench_whole" | tables)
growth=$("$bin/bench_growth" docs/results)
gnuplot -e "folder='docs/results'" tests/bench/growth.gp
{
    sed -n '/^<!-- measured -->$/q;p' tests/bench/features_page.md
    printf 'Made at commit %s on %s.\n\n' "$(git rev-parse --short=8 HEAD)" "$(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1), $(nproc) cores, load $(cut -d' ' -f1 /proc/loadavg)"
    printf '## Exact EMD against peers\n\n%s\n\n## Whole maps\n\n%s\n\n## The whole way of a raw frame\n\n%s\n\n## How cost grows\n\n%s\n\n![cost of a map](growth.png)\n\n' "$emd" "$features" "$whole" "$growth"
    sed '1,/^<!-- measured -->$/d' tests/bench/features_page.md
} >"$out.new"
mv "$out.new" "$out"
