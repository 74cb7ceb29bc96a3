#!/usr/bin/env bash
# Writes docs/reliability.md from what the planted bugs, the soak, the coverage and the runs in real time say.
#
#     tests/system/mutants/report.sh [PARTS [FOLDER]]     (10,000,000, build/reliability; build/release must be built with its tests)
#
# What FOLDER has already is not run again: remove it to measure anew.
#     mutants.txt soak.txt soak.time soak.commit nightly.txt   by this command
#     same-bits.txt                                            what tests/system/mutants/same_bits.sh says
#     hour.txt                                                 by the command in tests/system/realtime/README.md; without it the page says so
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
parts=${1:-10000000}
out=${2:-build/reliability}
bin=build/release
mkdir -p "$out"

if [ ! -s "$out/mutants.txt" ]; then
    for patch in tests/system/mutants/*.patch; do
        case $patch in *.2.patch) continue ;; esac
        name=$(basename "$patch" .patch)
        said=$(for seed in 1 2 3 4 5; do
            { "$bin/tests/system/mutants/mutant-$name" --parts 1000000 --seed "$seed" || true; } | head -1  # status 1: caught
        done | sed 's/ parts, no promise broken.*/ parts: not caught:/' | sort -n)
        parts=$(sed 's/ parts: .*//' <<<"$said")
        promises=$(sed 's/.* parts: //; s/:.*//' <<<"$said" | sort -u | paste -sd, | sed 's/,/, /g')
        echo "| $name | $(head -1 "$patch") | $(sed -n 3p <<<"$parts") | $(sed -n 5p <<<"$parts") | $promises |"
    done >"$out/mutants.new"
    echo "The same program without a bug: $("$bin/tests/system/mutants/mutant-none" || true) (commit $(git describe --always --dirty))." >>"$out/mutants.new"
    mv "$out/mutants.new" "$out/mutants.txt"
fi
if [ ! -s "$out/soak.txt" ]; then
    TIMEFORMAT='%U s of processor time, %R s by the clock'
    { time "$bin/bin/hord-lab" soak --parts "$parts" --seed 1 >"$out/soak.new" 2>/dev/null; } 2>"$out/soak.time" || true
    mv "$out/soak.new" "$out/soak.txt"
    git describe --always --dirty >"$out/soak.commit"
fi
if [ ! -s "$out/nightly.txt" ]; then
    "$bin/bin/hord-lab" soak --profile nightly --parts 1500000 --seed 2 --coverage >"$out/nightly.new" 2>/dev/null || true
    mv "$out/nightly.new" "$out/nightly.txt"
fi

indented() { sed 's/^/    /; s/ *$//'; }
{
    cat tests/system/mutants/reliability.head.md
    echo
    echo "## Planted bugs"
    echo
    echo "Each is a patch in \`tests/system/mutants/\`, applied to a copy of the file by the build; the test"
    echo "\`Mutant.NAME\` fails unless the soak catches it."
    echo "\`parts\`: how many had come when the first promise was broken (seeds 1 to 5, episodes of 500 parts). A new fault in"
    echo "the soak changes what a seed draws, and with it these numbers."
    echo
    echo "| bug | what it is | parts, median | parts, most | promise broken |"
    echo "|---|---|---:|---:|---|"
    cat <(grep '^|' "$out/mutants.txt") <(echo) <(grep -v '^|' "$out/mutants.txt")
    echo
    echo "## The soak"
    echo
    echo "    hord-lab soak --parts $parts --seed 1"
    echo
    indented <"$out/soak.txt"
    echo
    echo "Of commit $(cat "$out/soak.commit"). It took $(tail -n 1 "$out/soak.time"), on a machine that had other work."
    echo "The same seed gives the same report, whatever \`--threads\` says (\`Soak.the_same_seed_gives_the_same_bits\`)."
    if [ -s "$out/same-bits.txt" ]; then
        echo
        echo "    tests/system/mutants/same_bits.sh"
        echo
        indented <"$out/same-bits.txt"
    fi
    echo
    echo "## Coverage"
    echo
    echo "    hord-lab soak --profile nightly --parts 1500000 --seed 2 --coverage"
    echo
    echo "$(awk '$1 == "parts" {print $2; exit}' "$out/nightly.txt") parts, $(awk '$1 == "violations" {print $2; exit}' "$out/nightly.txt") violations. How often the core"
    echo "stepped through which event in which state; every fault has met every other one."
    echo
    sed -n '/^event /,$p' "$out/nightly.txt" | indented
    echo
    echo "## Real time"
    echo
    if [ -s "$out/hour.txt" ]; then
        cat tests/system/realtime/README.md | sed -n '/^    chrt /,$p'
        echo
        indented <"$out/hour.txt"
    else
        echo "Not measured for this page: tests/system/realtime/README.md."
    fi
} >docs/reliability.md.new
mv docs/reliability.md.new docs/reliability.md
