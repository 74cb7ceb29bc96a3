#!/bin/bash
# Counts the instructions of each kernel on arm64 and on x86-64 without AVX, by the same method, and prints
# docs/results/arm64.md: count_kernels.sh [FOLDER], where FOLDER keeps the objects (default build/count_kernels). Needs
# g++-aarch64-linux-gnu and qemu-user-static.
#
# Both programs are built with -O2 from the same sources. qemu lists the instructions of each block that it translates
# (-d in_asm) and logs each block that runs (-d exec,nochain). The instructions of the blocks that run between
# count_begin() and count_end() are counted (count_kernels.cpp). qemu64 is an x86-64 processor without AVX.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../../.."
mkdir -p "${1:-build/count_kernels}"
folder=$(readlink -f "${1:-build/count_kernels}")
most=2  # times the instructions of x86-64

export launcher folder
launcher=$(command -v ccache || true)
compile() {  # COMPILER SOURCE, if it or a header is newer than its object
    local object=$folder/$1/${2//\//_}.o
    [ "$object" -nt "$2" ] && [ -z "$(find algo common -name "*.h" -newer "$object" -print -quit)" ] && return
    $launcher "$1" -std=c++20 -O2 -pthread -ffp-contract=off -Wno-psabi -I"$PWD" -c "$PWD/$2" -o "$object"
}
export -f compile
for compiler in aarch64-linux-gnu-g++ x86_64-linux-gnu-g++; do
    mkdir -p "$folder/$compiler"
    for source in tests/bench/arm64/count_kernels.cpp algo/{emd,features,frame,light,maps,recipe,reference,simd,soa}/*.cpp; do
        echo "$compiler $source"
    done
done | xargs -P "${JOBS:-2}" -L1 bash -c 'compile "$@"' compile
for compiler in aarch64-linux-gnu-g++ x86_64-linux-gnu-g++; do
    $compiler -static -pthread "$folder/$compiler"/*.o -o "$folder/$compiler/count_kernels"
done

instructions() {  # PROGRAM QEMU OPTIONS...: a number a kernel
    "${@:2}" -d in_asm,exec,nochain "$1" 2>&1 >"$folder/kernels.txt" | awk '
        /^Trace/ {
            if ($NF == "count_begin") { counts = 1; total = 0; next }
            if ($NF == "count_end") { counts = 0; printf "%d\n", total; next }
            if (counts) { split($4, at, "/"); total += size[at[2]] }
            next
        }
        /^IN:/ { first = 1; next }
        /^0x/ {
            if (first) { block = sprintf("%16s", substr($1, 3, length($1) - 3)); gsub(/ /, "0", block); size[block] = 0; first = 0 }
            for (k = 2; k <= NF; ++k) if ($k !~ /^[0-9a-f][0-9a-f]$/) { size[block]++; break }  # else the rest of a long one
        }'
}
instructions "$folder/aarch64-linux-gnu-g++/count_kernels" qemu-aarch64-static >"$folder/arm64.txt"
instructions "$folder/x86_64-linux-gnu-g++/count_kernels" qemu-x86_64-static -cpu qemu64 >"$folder/x86_64.txt"
cat tests/bench/arm64/kernels_page.md
printf '\n<!-- %s and %s, commit %s -->\n\n' "$(aarch64-linux-gnu-g++ --version | head -1)" "$(qemu-aarch64-static --version | head -1)" "$(git describe --always --dirty 2>/dev/null)"
echo "| kernel | a | arm64 instructions | x86-64 instructions | arm64 / x86-64 | at most ${most}x |"
echo "|---|---|---|---|---|---|"
paste -d';' "$folder/kernels.txt" "$folder/arm64.txt" "$folder/x86_64.txt" | awk -F';' -v most=$most '
    { printf "| %s | %s | %.1f | %.1f | %.2fx | %s |\n", $1, $2, $4 / $3, $5 / $3, $4 / $5, $4 <= most * $5 ? "reached" : "not reached" }'
