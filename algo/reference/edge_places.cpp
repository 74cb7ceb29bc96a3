#include "algo/reference/edge_places.h"

#include <algorithm>

#include "algo/frame/mask.h"
#include "algo/reference/edge_agreement.h"

namespace hord::algo {
namespace {

constexpr int kReach = 2;  // as that of edge_agreement.cpp

// Calls `each(m, n)` for the lenslets around which the reference's light changes across the axis as at an edge.
template <class Each>
void for_each_edge(const Extents& extents, const ReferenceMaps& reference, std::size_t axis, double typical,
                   Each&& each) {
    const auto apart = axis == 0 ? std::ptrdiff_t{1} : std::ptrdiff_t{extents.m};
    for (int n = kReach; n + kReach < extents.n; ++n) {
        for (int m = kReach; m + kReach < extents.m; ++m) {
            const float* at = reference.light.data() + extents.index(m, n);
            float least = *at, most = *at;
            for (std::ptrdiff_t k = -kReach; k <= kReach; ++k)
                least = std::min(least, at[k * apart]), most = std::max(most, at[k * apart]);
            if (static_cast<double>(most - least) > kForeignLight * typical) each(m, n);
        }
    }
}

// Chooses a share of the lenslets of any line evenly: multiples of the golden ratio lie evenly in 0..1.
struct Chooser {
    std::size_t of, seen = 0;
    bool next() { return seen++ * 1597 % 2584 * of < 2584 * EdgePlaces::kMax; }
};

}  // namespace

bool EdgePlaces::collect(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                         const PoseMap& map, std::size_t axis, double typical, double light) {
    std::size_t edges = 0;
    double sum = 0;
    const auto along = [&](int m, int n) { return axis == 0 ? m : n; };
    for_each_edge(extents, reference, axis, typical, [&](int m, int n) { ++edges, sum += along(m, n); });
    if (2 * edges < static_cast<std::size_t>(extents.m + extents.n)) return false;
    const double middle = sum / static_cast<double>(edges);
    Chooser chooser{edges};
    for_each_edge(extents, reference, axis, typical, [&](int m, int n) {
        if (!chooser.next()) return;
        const auto p = map.to_part(m, n);
        const int at_m = floor_of(p.m + 0.5), at_n = floor_of(p.n + 0.5);
        if (at_m < 0 || at_n < 0 || at_m >= extents.m || at_n >= extents.n) return;
        const std::size_t at = extents.index(at_m, at_n), which = along(m, n) < middle ? 0 : 1;
        if ((part.mask[at] & kSaturated) != 0 || count[which] == kMax) return;
        const auto q = map.to_reference(at_m, at_n);
        of[which][count[which]++] = {q.m, q.n, static_cast<double>(part.sums[at]) / (light * typical)};
    });
    return true;
}

}  // namespace hord::algo
