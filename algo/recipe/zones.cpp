#include "algo/recipe/zones.h"

#include <algorithm>
#include <vector>

#include "algo/frame/mask.h"

namespace hord::algo {

bool Zone::contains(float m, float n) const {
    if (shape == Shape::circle) {
        const float right = m - centre.m, down = n - centre.n;
        return right * right + down * down <= radius * radius;
    }
    bool inside = false;  // crossings of the ray to the left
    for (std::size_t k = 0, last = corners.size() - 1; k < corners.size(); last = k++) {
        const Point a = corners[last], b = corners[k];
        if ((a.n <= n) == (b.n <= n)) continue;
        const float crossing = a.m + (n - a.n) / (b.n - a.n) * (b.m - a.m);
        if (crossing <= m) inside = !inside;
    }
    return inside;
}

void paint_zones(std::span<const Zone> zones, const Extents& extents, std::span<std::uint8_t> mask, float lenslet_mm) {
    const auto mm = [&](int k, int count) {
        return static_cast<float>((k - 0.5 * (count - 1)) * static_cast<double>(lenslet_mm));
    };
    const bool only_inside = std::ranges::any_of(zones, [](const Zone& z) { return z.use == Zone::Use::inspect; });
    std::size_t k = 0;
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m, ++k) {
            bool inspected = !only_inside, ignored = false;
            for (const Zone& zone : zones) {
                const bool in_mm = zone.unit == Zone::Unit::mm;
                if (!zone.contains(in_mm ? mm(m, extents.m) : static_cast<float>(m),
                                   in_mm ? mm(n, extents.n) : static_cast<float>(n)))
                    continue;
                (zone.use == Zone::Use::inspect ? inspected : ignored) = true;
            }
            mask[k] = inspected && !ignored ? kValid : kOutside;
        }
    }
}

bool leaves_nothing(std::span<const Zone> zones, const Extents& extents, float lenslet_mm) {
    std::vector<std::uint8_t> mask(extents.lenslets());
    paint_zones(zones, extents, mask, lenslet_mm);
    return std::ranges::find(mask, kValid) == mask.end();
}

}  // namespace hord::algo
