#!/usr/bin/env bash
# Makes docs/results/tune.md and its plots: tests/bench/tune_page.sh POVRAY, POVRAY the folder `povray/poses` of the
# test data (after `cmake --build --preset release --target hordctl tune_frames`). Needs gnuplot. A few minutes.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
povray=$(readlink -f "$1") bin=$PWD/build/release/bin results=$PWD/docs/results work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"$bin/tune_frames" . "$povray"
"$bin/hordctl" learn production/learn/*.png --bits 12 --out lens.hordref --no-check >learn.txt

# run NAME TITLE ARGUMENTS...: what hordctl tune says, as a section of the page.
run() {
    local name=$1 title=$2
    shift 2
    "$bin/hordctl" tune "$@" --out "$name.toml" --json >"$name.json" 2>"$name.err" || { cat "$name.err" >&2; return 1; }
    printf '## %s\n\n    hordctl tune %s --out %s.toml\n\n' "$title" "$*" "$name"
    sed -e '1,4d' -e "s/($name.tune.png)/(tune-$name.png)/" "$name.tune.md"
    printf '\n'
    cp "$name.tune.png" "$results/tune-$name.png"
}
{
    sed -n '/^<!-- measured -->$/q;p' "$OLDPWD/tests/bench/tune_page.md"
    printf 'Run on %s at commit %s, on %s. tune_frames draws its frames with fixed seeds.\n\n' "$(date -u +%F)" \
        "$(git -C "$OLDPWD" rev-parse --short=8 HEAD)" "$(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1), $(nproc) cores, load $(cut -d' ' -f1 /proc/loadavg)"
    run povray 'Traced lens: bubbles, a cut, a scratch and a speck' --good povray/good --bad povray/bad --budget 100
    run production 'Simulated production: haze, small bubbles, specks' --good production/good --bad production/bad --budget 100 --bits 12
    run tight 'The same within 0.4 ms' --good production/good --bad production/bad --budget 0.4 --bits 12
    printf 'The reference of the next section:\n\n    hordctl learn production/learn/*.png --bits 12 --out lens.hordref --no-check\n\n'
    sed 's/^/- /' learn.txt
    printf '\n'
    run reference 'The same with a reference' --good production/good --bad production/bad --budget 100 --bits 12 --reference lens.hordref
    sed '1,/^<!-- measured -->$/d' "$OLDPWD/tests/bench/tune_page.md"
} >page.md
cp page.md "$results/tune.md"
