#include "algo/reference/edge_classes.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr float kJumpBins = 0.5F, kJumpLight = 0.1F;  // between neighbours of the reference

}  // namespace

std::vector<std::int16_t> edge_classes(const Reference& r) {
    const Extents& e = r.extents;
    std::vector<std::int16_t> levels(e.lenslets(), -1), classes(e.lenslets(), -1);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            if (r.mask[k] != kValid) continue;
            float jump = 0;  // over the least
            const auto compare = [&](int x, int y) {
                if (x < 0 || y < 0 || x >= e.m || y >= e.n) return;
                const std::size_t at = e.index(x, y);
                if ((r.mask[at] & kOutside) != 0) return;
                jump = std::max(jump, std::abs(r.light[at] / r.light[k] - 1) / kJumpLight);
                if (r.mask[at] == kValid)
                    jump = std::max(jump, std::max(std::abs(r.x[at] - r.x[k]), std::abs(r.y[at] - r.y[k])) / kJumpBins);
            };
            compare(m - 1, n), compare(m + 1, n), compare(m, n - 1), compare(m, n + 1);
            if (jump > 1) levels[k] = static_cast<std::int16_t>(std::min(std::ilogb(jump), kMaxEdgeLevel));
        }
    }
    for (int distance = kEdgeReach; distance >= 0; --distance) {
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                std::int16_t level = -1;
                e.for_each_around(m, n, distance,
                                  [&](int x, int y) { level = std::max(level, levels[e.index(x, y)]); });
                if (level >= 0) classes[e.index(m, n)] = static_cast<std::int16_t>(level * (kEdgeReach + 1) + distance);
            }
        }
    }
    return classes;
}

}  // namespace hord::algo
