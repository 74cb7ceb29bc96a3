#include "algo/reference/free_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr double kNearer = 0.5;           // share of the light that is an empty field's: nearer to it than to the part
constexpr double kCertain = kNearer / 8;  // standard error of the share, at most
// The variance of R over that of its noise, at least: noise makes `a` smaller by 1 in so many.
constexpr double kMinContrast = 16;
constexpr int kMinLenslets = 64;
constexpr std::size_t kSide = 8;  // cells along a side of the field; what good parts differ by is alike within a cell

// Sums of a fit of s = a R + b, each lenslet weighted by 1 / R: the variance of light is in proportion to it.
struct Sums {
    double n = 0, w = 0, r = 0, s = 0, rr = 0, rs = 0, ss = 0;

    void add(double reference, double light) {
        const double weight = 1 / reference;
        n += 1, w += weight, r += 1, s += weight * light, rr += reference, rs += light, ss += weight * light * light;
    }
    void add(const Sums& o) { n += o.n, w += o.w, r += o.r, s += o.s, rr += o.rr, rs += o.rs, ss += o.ss; }
};
using Cells = std::array<Sums, kSide * kSide>;

// Of the cells in columns and rows from `left` and `top` on, `side` of them.
bool is_empty(const Cells& cells, std::size_t left, std::size_t top, std::size_t side, double electrons_per_dn,
              std::uint32_t parts) {
    const auto for_each = [&](auto&& visit) {
        for (std::size_t row = top; row < top + side; ++row) {
            for (std::size_t column = left; column < left + side; ++column) visit(cells[row * kSide + column]);
        }
    };
    Sums all;
    for_each([&](const Sums& cell) { all.add(cell); });
    if (all.n < kMinLenslets) return false;
    const double mean_r = all.r / all.w, mean_s = all.s / all.w, of_r = all.rr - all.w * mean_r * mean_r,
                 of_rs = all.rs - all.w * mean_r * mean_s, of_s = all.ss - all.w * mean_s * mean_s;
    if (!(of_r > 0 && mean_s > 0)) return false;
    const double a = of_rs / of_r, rest = std::max(of_s - a * of_rs, 0.0) / (all.n - 2),
                 scale = mean_s / mean_r;  // light of the frame, over the reference's
    // What photons leave in the frame is less in the reference, which was learned in full light; what they do not
    // explain differs from part to part.
    const double beyond_photons = std::max(rest - scale / electrons_per_dn, 0.0) / (scale * scale),
                 noise_of_r = (beyond_photons + 1 / electrons_per_dn) / parts;
    if (of_r < kMinContrast * all.n * noise_of_r) return false;
    // The standard error from what each cell adds to the fit's gradient: lenslets of a cell may deviate together.
    double squares = 0;
    for_each([&](const Sums& c) {
        const double of_cell = c.rs - mean_s * c.r - mean_r * c.s + mean_r * mean_s * c.w -
            a * (c.rr - 2 * mean_r * c.r + mean_r * mean_r * c.w);
        squares += of_cell * of_cell;
    });
    const double share = 1 - a / scale, error = std::sqrt(squares) / of_r / scale;
    return share > kNearer && error < kCertain;
}

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
    Cells cells;
    const auto cell_of = [](int k, int count) {
        return static_cast<std::size_t>(k) * kSide / static_cast<std::size_t>(count);
    };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            if ((part.mask[k] & (kDark | kSaturated)) != 0) continue;
            const auto light = light_at(e, reference, map.to_reference(m, n));
            if (light) cells[cell_of(n, e.n) * kSide + cell_of(m, e.m)].add(*light, part.sums[k]);
        }
    }
    constexpr std::size_t kHalf = kSide / 2;
    for (const std::size_t top : {std::size_t{0}, kHalf}) {
        for (const std::size_t left : {std::size_t{0}, kHalf}) {
            if (is_empty(cells, left, top, kHalf, electrons_per_dn, parts)) return true;
        }
    }
    return is_empty(cells, 0, 0, kSide, electrons_per_dn, parts);
}

}  // namespace hord::algo
