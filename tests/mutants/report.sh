#!/usr/bin/env bash
# Writes docs/reliability.md from what the soak, the planted bugs and the coverage say now.
#
#     tests/mutants/report.sh [PARTS]     (10,000,000; build/release must be built)
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
parts=${1:-10000000}
bin=build/release
{
    cat tests/mutants/reliability.head.md
    echo
    echo "## Planted bugs"
    echo
    echo "Each is a patch in \`tests/mutants/\`, applied to a copy of the file by the build; the test \`Mutant.NAME\` fails unless the soak catches it."
    echo "\`parts\`: how many had come when the first promise was broken (seed 1, episodes of 500 parts)."
    echo
    echo "| bug | what it is | parts | promise broken |"
    echo "|---|---|---:|---|"
    for patch in tests/mutants/*.patch; do
        case $patch in *.2.patch) continue ;; esac
        name=$(basename "$patch" .patch)
        said=$("$bin/tests/mutants/mutant-$name" | head -1)
        caught=${said#*parts: }
        case $said in *"no promise broken"*) echo "| $name | $(head -1 "$patch") | not caught | |" ;;
            *) echo "| $name | $(head -1 "$patch") | ${said%% parts*} | ${caught%%:*} |" ;; esac
    done
    echo
    echo "The same program without a bug: $("$bin/tests/mutants/mutant-none")."
    echo
    echo "## The soak"
    echo
    echo "    hordctl soak --parts $parts --seed 1"
    echo
    start=$(date +%s.%N)
    "$bin/bin/hordctl" soak --parts "$parts" --seed 1 2>/dev/null | sed 's/^/    /'
    user=$(awk -v s="$start" -v e="$(date +%s.%N)" 'BEGIN{printf "%.0f", e-s}')
    echo
    echo "It took $user s of wall-clock time on one core of a machine shared with other work."
    echo
    echo "## Coverage"
    echo
    echo "    hordctl soak --profile nightly --coverage"
    echo
    "$bin/bin/hordctl" soak --profile nightly --coverage 2>/dev/null | sed -n '/^event /,$p' | sed 's/^/    /'
} >docs/reliability.md.new
mv docs/reliability.md.new docs/reliability.md
