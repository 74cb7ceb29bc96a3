#include "algo/reference/edge_agreement.h"

#include <cmath>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// Two lenslets on each side. A bevel of one lenslet that lies between two lenslets of the part has three quarters of
// its steps where the reference has them, and half of them if it lies a whole lenslet away.
constexpr int kReach = 2;

// Mean change of a map from before a lenslet to behind it; `apart`: the next lenslet, along x or y.
template <class ValueAt>
double step_at(std::size_t k, std::size_t apart, ValueAt&& value) {
    return 0.5 * (value(k + 2 * apart) + value(k + apart) - value(k - apart) - value(k - 2 * apart));
}
// Fewer edges are specks.
double enough_edges(const Extents& extents) { return 0.5 * (extents.m + extents.n); }
std::uint8_t bits_around(std::span<const std::uint8_t> mask, std::size_t k, std::size_t apart) {
    return static_cast<std::uint8_t>(mask[k + 2 * apart] | mask[k + apart] | mask[k] | mask[k - apart] |
                                     mask[k - 2 * apart]);
}

}  // namespace

EdgeAgreement compare_edges(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                            const PoseMap& map, double typical, double light) {
    EdgeAgreement result;
    result.enough = enough_edges(extents);
    const std::array<std::size_t, 2> next{1, static_cast<std::size_t>(extents.m)};
    const auto of = [](std::span<const float> values) {
        return [=](std::size_t k) { return static_cast<double>(values[k]); };
    };
    const auto sums = [&](std::size_t k) { return static_cast<double>(part.sums[k]) / light; };
    const auto x = [&](std::size_t k) { return part.deflections[k].x.to_double_rounded(); };
    const auto y = [&](std::size_t k) { return part.deflections[k].y.to_double_rounded(); };
    const auto inside = [&](int m, int n) {
        return m >= kReach && n >= kReach && m + kReach < extents.m && n + kReach < extents.n;
    };
    // Of the reference's step the share that the part has.
    const auto compare = [&](std::size_t axis, int m, int n) {
        const std::size_t k = extents.index(m, n), apart = next[axis];
        const std::uint8_t around = bits_around(reference.mask, k, apart);
        if ((around & (kOutside | kSaturated)) != 0) return;
        const double step = step_at(k, apart, of(reference.light));
        const bool by_light = std::abs(step) > kForeignLight * typical;
        double step_x = 0, step_y = 0;
        if (!by_light && (around & kDark) == 0)
            step_x = step_at(k, apart, of(reference.x)), step_y = step_at(k, apart, of(reference.y));
        const double square = step_x * step_x + step_y * step_y;
        if (!by_light && square <= kForeignBins * kForeignBins) return;
        const auto p = map.to_part(m, n);
        const int at_m = floor_of(p.m + 0.5), at_n = floor_of(p.n + 0.5);
        if (!inside(at_m, at_n)) return;
        const std::size_t at = extents.index(at_m, at_n);
        double share = 0;
        if (by_light) {
            share = step_at(at, apart, sums) / step;
        } else {
            if ((bits_around(part.mask, at, apart) & kNoHord) != 0) return;
            share = (step_at(at, apart, x) * step_x + step_at(at, apart, y) * step_y) / square;
        }
        result.edges[axis] += 1;
        result.of_light[axis] += by_light ? 1 : 0;
        result.missing[axis] += 1 - std::clamp(share, -1.0, 1.0);
    };
    for (int n = kReach; n + kReach < extents.n; ++n) {
        for (int m = kReach; m + kReach < extents.m; ++m) compare(0, m, n), compare(1, m, n);
    }
    return result;
}

bool shows_edges(const Extents& extents, const PartMaps& part, double typical) {
    const std::array<std::size_t, 2> next{1, static_cast<std::size_t>(extents.m)};
    const auto sums = [&](std::size_t k) { return static_cast<double>(part.sums[k]); };
    const auto x = [&](std::size_t k) { return part.deflections[k].x.to_double_rounded(); };
    const auto y = [&](std::size_t k) { return part.deflections[k].y.to_double_rounded(); };
    double edges = 0;
    for (int n = kReach; n + kReach < extents.n; ++n) {
        for (int m = kReach; m + kReach < extents.m; ++m) {
            const std::size_t k = extents.index(m, n);
            const auto is_edge = [&](std::size_t apart) {
                const std::uint8_t around = bits_around(part.mask, k, apart);
                if ((around & kSaturated) != 0) return false;
                if (std::abs(step_at(k, apart, sums)) > kForeignLight * typical) return true;
                return (around & kNoHord) == 0 && std::hypot(step_at(k, apart, x), step_at(k, apart, y)) > kForeignBins;
            };
            edges += is_edge(next[0]) || is_edge(next[1]) ? 1 : 0;
        }
    }
    return edges >= enough_edges(extents);
}

}  // namespace hord::algo
