#!/usr/bin/env bash
# Lines of C++ a room, and what is longer than it should be.
#
#     tests/tools/size.sh [REVISION]     (the working tree; with REVISION that commit)
#
# "product" is what the station runs: every room but lab/ and tests/. Lines are those of .h and .cpp files, comments
# included; a file should have at most 450.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
revision=${1:-}

list() { if [ -n "$revision" ]; then git ls-tree -r --name-only "$revision"; else git ls-files; fi | grep -E '\.(h|cpp)$'; }
text() { if [ -n "$revision" ]; then git show "$revision:$1"; else cat "$1"; fi; }

list | while read -r file; do printf '%s %s\n' "$(text "$file" | wc -l)" "$file"; done | awk '
    {
        n = split($2, part, "/")
        room = part[1]
        folder = n > 2 ? part[1] "/" part[2] : part[1]
        lines[room] += $1; files[room]++
        if (room != "tests") { in_folder[folder] += $1; many[folder]++ }
        # Before there was a lab, its files were in firmware/.
        lab = room == "lab" || $2 ~ /^firmware\/(experiment|tune|soak)\// || $2 ~ /^firmware\/hordctl\/(experiment|soak|scene|scene_needs|render)\./
        if (lab) in_lab += $1
        else if (room != "tests") product += $1
        if ($1 > 450) long[$2] = $1
    }
    END {
        for (f in in_folder) printf "%8d lines %4d files  %s\n", in_folder[f], many[f], f | "sort -k5"
        close("sort -k5")
        print ""
        for (r in lines) printf "%8d lines %4d files  %s/\n", lines[r], files[r], r | "sort -k5"
        close("sort -k5")
        printf "\n%8d lines  product (without lab and tests)\n%8d lines  lab\n", product, in_lab
        for (f in long) printf "%8d lines, above 450: %s\n", long[f], f | "sort -rn"
    }'
