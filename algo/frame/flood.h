// Flood fill over the lenslets of a field.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <span>

#include "algo/frame/extents.h"

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

}  // namespace hord::algo
