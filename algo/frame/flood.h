// Flood fill over the lenslets of a field.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/frame/lenslet_scan.h"

namespace hord::algo {

enum class Connected : std::uint8_t { at_sides, at_corners_too };

// Finds the lenslets connected to `seed`, over at most `reach` lenslets. enter(index) returns true if a lenslet
// belongs to them, at most once per lenslet. Returns their number; `queue`, with room for the field, begins with them.
template <class Enter>
std::size_t flood(const Extents& e, std::uint32_t seed, int reach, Connected connected, std::span<std::uint32_t> queue,
                  Enter&& enter) {
    std::size_t count = 0;
    if (enter(seed)) queue[count++] = seed;
    for (std::size_t q = 0; q < count; ++q) {
        const int m = static_cast<int>(queue[q]) % e.m, n = static_cast<int>(queue[q]) / e.m;
        e.for_each_around(m, n, reach, [&](int x, int y) {
            if (connected == Connected::at_sides && x != m && y != n) return;
            const auto k = static_cast<std::uint32_t>(e.index(x, y));
            if (enter(k)) queue[count++] = k;
        });
    }
    return count;
}

// A run of lenslets in a row: the first lenslet of the row, and the first and the last of the run.
struct FloodRun {
    std::uint32_t row, first, last;
};
constexpr std::size_t max_flood_runs(const Extents& e) {
    return static_cast<std::size_t>(e.n) * static_cast<std::size_t>((e.m + 1) / 2);
}

struct Flooded {
    std::size_t lenslets = 0, runs = 0;
};

// The same lenslets as flood() with a reach of 1, in another order, run by run along the rows: `runs`, with room for
// max_flood_runs(), begins with their runs. open(index): the lenslet belongs to them and is not marked yet. mark(index)
// marks it.
template <class Open, class Mark>
Flooded flood_by_runs(const Extents& e, std::uint32_t seed, Connected connected, std::span<FloodRun> runs, Open&& open,
                      Mark&& mark) {
    const auto columns = static_cast<std::uint32_t>(e.m), lenslets = static_cast<std::uint32_t>(e.lenslets());
    const std::uint32_t reach = connected == Connected::at_corners_too ? 1 : 0;
    Flooded found;
    // Marks the run around the open lenslet k.
    const auto add_run = [&](std::uint32_t k, std::uint32_t row) {
        std::uint32_t first = k;
        while (first > row && open(first - 1)) --first;
        const std::size_t end = first_suiting(k + 1, row + columns, [&](std::size_t at) { return !open(at); });
        for (std::size_t at = first; at < end; ++at) mark(at);
        const auto last = static_cast<std::uint32_t>(end - 1);
        runs[found.runs++] = {row, first, last};
        found.lenslets += last - first + 1;
    };
    if (open(seed)) add_run(seed, seed / columns * columns);
    for (std::size_t r = 0; r < found.runs; ++r) {
        const FloodRun run = runs[r];
        const auto look_in = [&](std::uint32_t row) {
            const std::uint32_t from = std::max(run.first - run.row, reach) - reach,
                                to = std::min(run.last - run.row + reach, columns - 1);
            for_each_suiting(row + from, row + to + 1, open,
                             [&](std::size_t k) { add_run(static_cast<std::uint32_t>(k), row); });
        };
        if (run.row >= columns) look_in(run.row - columns);
        if (run.row + columns < lenslets) look_in(run.row + columns);
    }
    return found;
}

}  // namespace hord::algo
