#!/bin/bash
# Runs fuzz targets and prints a table: run.sh BIN RUNS [TARGET...]. HORD_FUZZ_SECONDS ends each target after this time;
# HORD_FUZZ_SEED (1) lets a later piece of a long run draw other inputs.
# Inputs with new coverage and findings are left in build/fuzz/found/TARGET. Times are processor times: a busy machine does
# not change them much. Exit status: 1 if there is a finding, or a target did not run.
set -u
# Freed memory stays unusable until as much as this was freed after it: more than an execution frees. Of 256 MB, the
# default, every page is new to the processor's caches. To see the whole stacks of a finding's memory, run its input alone.
export ASAN_OPTIONS=quarantine_size_mb=16:malloc_context_size=2${ASAN_OPTIONS:+:$ASAN_OPTIONS}
# -entropic=0: to weigh the corpus by rare features takes 39 % of the time of `toml`, and 2 % more edges are reached by
# the same executions.
TIMEFORMAT='%U %S'
bin=$1 runs=$2 here=$(dirname "$0") status=0
shift 2
[ $# -gt 0 ] || set -- $(ls "$here/corpus")
echo '| target | executions | processor time, s | executions a second of it | coverage at first, at last | findings |'
echo '|---|---|---|---|---|---|'
for name in "$@"; do
    found="$here/../../build/fuzz/found/$name"
    mkdir -p "$found/new"
    rm -f "$found"/crash-* "$found"/oom-* "$found"/timeout-* "$found"/leak-*
    case $name in  # files may be long; a framer holds one frame, and a message or an answer is short
        framer_*) max_len=1024 ;;
        camera | command | dispatcher | mqtt | page_request | strobe_reply) max_len=4096 ;;
        rows) max_len=512 ;;     # each change is an update of a row
        verdict) max_len=64 ;;  # a recipe and eight changes
        *) max_len=16384 ;;
    esac
    spent=$( { time "$bin/fuzz_$name" -runs="$runs" ${HORD_FUZZ_SECONDS:+-max_total_time=$HORD_FUZZ_SECONDS} -max_len=$max_len \
        -malloc_limit_mb=512 -rss_limit_mb=2048 -timeout=20 -seed="${HORD_FUZZ_SEED:-1}" -entropic=0 -print_final_stats=1 \
        -artifact_prefix="$found/" "$found/new" "$here/corpus/$name" >"$found/log" 2>&1; } 2>&1) || status=1
    findings=$(find "$found" -maxdepth 1 -type f ! -name log | wc -l)
    [ "$findings" -eq 0 ] || status=1
    awk -v name="$name" -v findings="$findings" -v spent="$spent" '
        /INITED/ { for (k = 1; k < NF; ++k) if ($k == "cov:") first = $(k + 1) }
        / cov: / { for (k = 1; k < NF; ++k) if ($k == "cov:") last = $(k + 1); split($1, n, "#"); executions = n[2] }
        /^Done/ { executions = $2 }
        /number_of_executed_units/ { executions = $2 }
        END { split(spent, t, " "); time = t[1] + t[2]; rate = (time > 0) ? executions / time : 0
              printf "| `%s` | %s | %.0f | %.0f | %s, %s | %s |\n", name, executions, time, rate, first, last,
                  findings }' "$found/log"
done
exit $status
