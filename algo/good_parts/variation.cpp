#include "algo/good_parts/variation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

using Channel = std::vector<float> PartMapSet::*;
constexpr std::array<Channel, 3> kChannels = {&PartMapSet::light, &PartMapSet::x, &PartMapSet::y};

// Eigenvalues and unit eigenvectors (columns of `vectors`) of a symmetric matrix, by Jacobi rotations.
void eigen(std::vector<double>& a, std::vector<double>& vectors, std::size_t n) {
    vectors.assign(n * n, 0);
    for (std::size_t k = 0; k < n; ++k) vectors[k * n + k] = 1;
    for (int sweep = 0; sweep < 30; ++sweep) {
        double off = 0, on = 0;
        for (std::size_t r = 0; r < n; ++r) {
            on += a[r * n + r] * a[r * n + r];
            for (std::size_t c = r + 1; c < n; ++c) off += a[r * n + c] * a[r * n + c];
        }
        if (off <= 1e-20 * on) return;
        for (std::size_t p = 0; p < n; ++p) {
            for (std::size_t q = p + 1; q < n; ++q) {
                if (a[p * n + q] == 0) continue;
                const double theta = (a[q * n + q] - a[p * n + p]) / (2 * a[p * n + q]);
                const double t = (theta >= 0 ? 1 : -1) / (std::abs(theta) + std::sqrt(theta * theta + 1)),
                             c = 1 / std::sqrt(t * t + 1), s = t * c;
                const auto turn = [&](double& x, double& y) {
                    const double u = x, v = y;
                    x = c * u - s * v, y = s * u + c * v;
                };
                for (std::size_t k = 0; k < n; ++k) turn(a[k * n + p], a[k * n + q]);
                for (std::size_t k = 0; k < n; ++k) turn(a[p * n + k], a[q * n + k]);
                for (std::size_t k = 0; k < n; ++k) turn(vectors[k * n + p], vectors[k * n + q]);
            }
        }
    }
}

// Each channel in units of its typical spread, so that light and deflections count alike.
std::array<double, 3> typical_spreads(const Variation& v) {
    std::array<double, 3> unit{};
    for (std::size_t c = 0; c < 3; ++c) {
        std::vector<double> spreads;
        for (std::size_t k = 0; k < v.mask.size(); ++k) {
            if (v.mask[k] == kValid) spreads.push_back(static_cast<double>((v.spread.*kChannels[c])[k]));
        }
        unit[c] = std::max(common::quantile(std::move(spreads), 0.5), 1e-9);
    }
    return unit;
}

// Principal modes by the products between parts, which are far fewer than places.
struct Modes {
    std::vector<double> values, vectors;  // values: on the diagonal of parts x parts; vectors: in its columns
    std::vector<std::size_t> order;       // of the columns, the greatest value first
    double total = 0;
};
// `difference(part, channel, place)` from the mean.
template <class Difference>
Modes modes_of(std::size_t parts, std::size_t places, const Difference& difference) {
    Modes of{std::vector<double>(parts * parts), {}, std::vector<std::size_t>(parts), 0};
    std::vector<double>& products = of.values;
    std::vector<double> row(parts);
    for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t k = 0; k < places; ++k) {
            for (std::size_t p = 0; p < parts; ++p) row[p] = difference(p, c, k);
            for (std::size_t p = 0; p < parts; ++p) {
                for (std::size_t q = p; q < parts; ++q) products[p * parts + q] += row[p] * row[q];
            }
        }
    }
    for (std::size_t p = 0; p < parts; ++p) {
        for (std::size_t q = 0; q < p; ++q) products[p * parts + q] = products[q * parts + p];
    }
    eigen(products, of.vectors, parts);
    for (std::size_t p = 0; p < parts; ++p) of.total += products[p * parts + p];
    std::iota(of.order.begin(), of.order.end(), std::size_t{0});
    std::ranges::sort(of.order,
                      [&](std::size_t a, std::size_t b) { return products[a * parts + a] > products[b * parts + b]; });
    return of;
}

}  // namespace

VariationMeter::VariationMeter(const Reference& reference)
    : reference_(reference), step_((std::max(reference.extents.m, reference.extents.n) + kMaxSide - 1) / kMaxSide),
      grid_{(reference.extents.m + step_ - 1) / step_, (reference.extents.n + step_ - 1) / step_, reference.extents.i,
            reference.extents.j} {}

void VariationMeter::add(const FrameView& frame, const Pose& pose) {
    if (parts_.size() >= kMaxParts) return;
    const Extents& e = reference_.extents;
    const std::uint32_t dark = reference_.levels.dark, least = reference_.levels.min_sum;
    PartMapSet raw;
    for (const Channel c : kChannels) (raw.*c).assign(e.lenslets(), kNone);
    std::vector<double> lit;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            double light = 0, x = 0, y = 0;
            for (int b = 0; b < e.bins(); ++b) {
                const int i = b % e.i, j = b / e.i;
                const std::uint32_t sample = frame.sample(m * e.i + i, n * e.j + j);
                const double here = sample > dark ? sample - dark : 0;
                light += here, x += here * (i - 0.5 * (e.i - 1)), y += here * (j - 0.5 * (e.j - 1));
            }
            if (light < std::max<double>(least, 1)) continue;
            const std::size_t k = e.index(m, n);
            raw.light[k] = static_cast<float>(light);
            raw.x[k] = static_cast<float>(x / light);
            raw.y[k] = static_cast<float>(y / light);
            lit.push_back(light);
        }
    }
    const auto typical = static_cast<float>(std::max(common::quantile(std::move(lit), 0.5), 1.0));
    const PoseMap map(pose, e), back({0, 0, -pose.sine}, e);
    PartMapSet part;
    for (int n = 0; n < grid_.n; ++n) {
        for (int m = 0; m < grid_.m; ++m) {
            const auto at = map.to_part(m * step_, n * step_);
            const int left = floor_of(at.m), top = floor_of(at.n);
            std::array<double, 3> sum{};
            bool all = left >= 0 && top >= 0 && left + 1 < e.m && top + 1 < e.n;
            for (int k = 0; k < 4 && all; ++k) {
                const double w =
                    (k % 2 == 0 ? left + 1 - at.m : at.m - left) * (k / 2 == 0 ? top + 1 - at.n : at.n - top);
                for (std::size_t c = 0; c < 3; ++c)
                    sum[c] += w * static_cast<double>((raw.*kChannels[c])[e.index(left + k % 2, top + k / 2)]);
                all = !std::isnan(sum[0]);
            }
            const auto turned = back.turned(sum[1], sum[2]);
            part.light.push_back(all ? static_cast<float>(sum[0]) / typical : kNone);
            part.x.push_back(all ? static_cast<float>(turned.m) : kNone);
            part.y.push_back(all ? static_cast<float>(turned.n) : kNone);
        }
    }
    parts_.push_back(std::move(part));
}

// Where at least half of the parts have light: their mean and spread. Elsewhere the mask is dark.
void VariationMeter::add_mean_and_spread(Variation& v) const {
    for (std::size_t k = 0; k < grid_.lenslets(); ++k) {
        const auto with = std::ranges::count_if(parts_, [&](const PartMapSet& p) { return !std::isnan(p.light[k]); });
        if (2 * static_cast<std::size_t>(with) < parts_.size()) {
            v.mask[k] = kDark;
            continue;
        }
        for (const Channel c : kChannels) {
            double sum = 0, squares = 0;
            for (const PartMapSet& p : parts_) {
                if (std::isnan((p.*c)[k])) continue;
                const auto value = static_cast<double>((p.*c)[k]);
                sum += value, squares += value * value;
            }
            const double mean = sum / static_cast<double>(with);
            (v.mean.*c)[k] = static_cast<float>(mean);
            (v.spread.*c)[k] =
                static_cast<float>(std::sqrt(std::max(0.0, squares / static_cast<double>(with) - mean * mean)));
        }
    }
}

Variation VariationMeter::finish(std::size_t modes) const {
    Variation v;
    v.grid = grid_;
    v.step = step_;
    v.parts = parts_.size();
    const std::size_t places = grid_.lenslets(), count = parts_.size();
    v.mask.assign(places, kValid);
    for (const Channel c : kChannels) (v.mean.*c).assign(places, 0), (v.spread.*c).assign(places, 0);
    if (count == 0) return v;
    add_mean_and_spread(v);
    const std::array<double, 3> unit = typical_spreads(v);
    const auto difference = [&](std::size_t part, std::size_t c, std::size_t k) {
        const float value = (parts_[part].*kChannels[c])[k];
        if (v.mask[k] != kValid || std::isnan(value)) return 0.0;
        return static_cast<double>(value - (v.mean.*kChannels[c])[k]) / unit[c];
    };
    const Modes found = modes_of(count, places, difference);
    const double root = std::sqrt(static_cast<double>(count));
    for (std::size_t rank = 0; rank < std::min(modes, count) && found.total > 0; ++rank) {
        const std::size_t which = found.order[rank];
        VariationMode mode;
        mode.share = found.values[which * count + which] / found.total;
        for (std::size_t p = 0; p < count; ++p) mode.amounts.push_back(found.vectors[p * count + which] * root);
        for (std::size_t c = 0; c < 3; ++c) {
            auto& map = mode.maps.*kChannels[c];
            map.assign(places, 0);
            for (std::size_t k = 0; k < places; ++k) {
                double sum = 0;
                for (std::size_t p = 0; p < count; ++p) sum += mode.amounts[p] * difference(p, c, k);
                map[k] = static_cast<float>(sum / static_cast<double>(count) * unit[c]);
            }
        }
        v.modes.push_back(std::move(mode));
    }
    return v;
}

}  // namespace hord::algo
