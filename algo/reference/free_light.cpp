#include "algo/reference/free_light.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr double kNearer = 0.5;           // share of the light that is an empty field's: nearer to it than to the part
constexpr double kCertain = kNearer / 4;  // of a good part, at most: four standard deviations below
// The variance of R over that of its noise, at least: noise makes `a` smaller by 1 in so many.
constexpr double kMinContrast = 16;
constexpr int kMinLenslets = 64;

// Sums of a fit of s = a R + b, each lenslet weighted by 1 / R: the variance of light is in proportion to it.
struct Sums {
    double n = 0, w = 0, r = 0, s = 0, rr = 0, rs = 0, ss = 0;

    void add(double reference, double light) {
        const double weight = 1 / reference;
        n += 1, w += weight, r += 1, s += weight * light, rr += reference, rs += light, ss += weight * light * light;
    }
    void add(const Sums& o) { n += o.n, w += o.w, r += o.r, s += o.s, rr += o.rr, rs += o.rs, ss += o.ss; }

    [[nodiscard]] bool is_empty(double electrons_per_dn, std::uint32_t parts) const {
        if (n < kMinLenslets) return false;
        const double mean_r = r / w, mean_s = s / w, of_r = rr - w * mean_r * mean_r, of_rs = rs - w * mean_r * mean_s,
                     of_s = ss - w * mean_s * mean_s;
        if (!(of_r > 0 && mean_s > 0)) return false;
        const double a = of_rs / of_r, rest = std::max(of_s - a * of_rs, 0.0) / (n - 2),
                     scale = mean_s / mean_r;  // light of the frame, over the reference's
        // What photons leave in the frame is less in the reference, which was learned in full light; what they do not
        // explain differs from part to part.
        const double beyond_photons = std::max(rest - scale / electrons_per_dn, 0.0) / (scale * scale),
                     noise_of_r = (beyond_photons + 1 / electrons_per_dn) / parts;
        if (of_r < kMinContrast * n * noise_of_r) return false;
        const double share = 1 - a / scale, error = std::sqrt(rest / of_r) / scale;
        return share > kNearer && error < kCertain;
    }
};

// R at a point, linearly between the four lenslets around it; none if one of them has no light.
std::optional<double> light_at(const Extents& e, const ReferenceMaps& reference, const PoseMap::Place& at) {
    const int m = floor_of(at.m), n = floor_of(at.n);
    if (m < 0 || n < 0 || m + 1 >= e.m || n + 1 >= e.n) return std::nullopt;
    const double u = at.m - m, v = at.n - n;
    double light = 0;
    for (int j = 0; j < 2; ++j) {
        for (int i = 0; i < 2; ++i) {
            const std::size_t k = e.index(m + i, n + j);
            if ((reference.mask[k] & (kOutside | kDark)) != 0 || !(reference.light[k] > 0)) return std::nullopt;
            light += (i == 0 ? 1 - u : u) * (j == 0 ? 1 - v : v) * static_cast<double>(reference.light[k]);
        }
    }
    return light;
}

}  // namespace

bool is_rather_empty(const Extents& e, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                     double electrons_per_dn, std::uint32_t parts) {
    Sums quarters[4];
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            if ((part.mask[k] & (kDark | kSaturated)) != 0) continue;
            const auto light = light_at(e, reference, map.to_reference(m, n));
            if (light) quarters[(2 * m < e.m ? 0 : 1) + (2 * n < e.n ? 0 : 2)].add(*light, part.sums[k]);
        }
    }
    Sums whole;
    for (const Sums& quarter : quarters) {
        if (quarter.is_empty(electrons_per_dn, parts)) return true;
        whole.add(quarter);
    }
    return whole.is_empty(electrons_per_dn, parts);
}

}  // namespace hord::algo
