#include "algo/light/exposures.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kEvery = 2;  // rows and columns that are read

// Second differences of one value along one axis, each with the sign of its place.
struct Turns {
    int count = 0, positive = 0;
    std::int64_t sum = 0;
    void add(std::int64_t value) {
        ++count;
        positive += value > 0 ? 1 : 0;
        sum += value;
    }
    // The mean; 0 if too few have the same sign.
    [[nodiscard]] double mean() const {
        const int in_turn = std::max(positive, count - positive);
        if (count < kMinAlternating || in_turn < kAlternatingShare * count) return 0;
        return std::abs(static_cast<double>(sum)) / count;
    }
};

template <class Sample>
double undeflected(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets, double x, double y) {
    const double middle_i = 0.5 * (e.i - 1) + x, middle_j = 0.5 * (e.j - 1) + y;
    std::array<double, kMaxFar> shares{};
    std::size_t count = 0;
    for (const std::uint32_t k : lenslets) {
        const int m = static_cast<int>(k) % e.m, n = static_cast<int>(k) / e.m;
        double all = 0, near = 0, far = 0;
        for (int j = 0; j < e.j; ++j) {
            const auto* samples =
                reinterpret_cast<const Sample*>(frame.data + (n * e.j + j) * frame.stride_bytes) + m * e.i;
            for (int i = 0; i < e.i; ++i) {
                const double light = samples[i] > dark_dn ? static_cast<double>(samples[i] - dark_dn) : 0;
                const double distance = std::max(std::abs(i - middle_i), std::abs(j - middle_j));
                all += light;
                near += distance <= 1.5 ? light : 0;
                far += distance > kFarBins ? light : 0;
            }
        }
        if (far >= kFarShare * (all - near) && far >= 0.1 * all && far > 0) shares[count++] = near / all;
        if (count == kMaxFar) break;
    }
    return count < kMinFar ? 0 : common::lower_median(std::span(shares).first(count));
}

// `sums`: light of each column or row of a lenslet.
bool is_split(std::span<const double> sums) {
    double all = 0;
    for (const double sum : sums) all += sum;
    const double outer = std::min(sums.front(), sums.back()),
                 middle = std::max(sums[(sums.size() - 1) / 2], sums[sums.size() / 2]);
    return outer > 0.1 * all && outer > 2 * middle;
}

}  // namespace

double split_share(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets) {
    std::array<double, kMaxBins> columns{}, rows{};
    std::size_t split = 0;
    for (const std::uint32_t k : lenslets) {
        const int left = static_cast<int>(k) % e.m * e.i, top = static_cast<int>(k) / e.m * e.j;
        columns.fill(0), rows.fill(0);
        for (int j = 0; j < e.j; ++j) {
            for (int i = 0; i < e.i; ++i) {
                const std::uint32_t sample = frame.sample(left + i, top + j);
                const double light = sample > dark_dn ? sample - dark_dn : 0;
                columns[static_cast<std::size_t>(i)] += light;
                rows[static_cast<std::size_t>(j)] += light;
            }
        }
        const bool any = is_split(std::span(columns).first(static_cast<std::size_t>(e.i))) ||
            is_split(std::span(rows).first(static_cast<std::size_t>(e.j)));
        split += any ? 1 : 0;
    }
    return lenslets.empty() ? 0 : static_cast<double>(split) / static_cast<double>(lenslets.size());
}

Alternation alternation(const Extents& e, std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                        std::span<const std::uint8_t> mask) {
    Alternation most;
    // One axis of a block: lenslets `begin` to `end` along it, `step` apart, in every second line across.
    const auto look = [&](std::size_t first, int lines, std::size_t across, int length, std::size_t step) {
        Turns x, y, light;
        std::int64_t light_sum = 0;
        for (int line = 0; line < lines; line += kEvery) {
            for (int at = 1; at + 1 < length; ++at) {
                const std::size_t k =
                    first + static_cast<std::size_t>(line) * across + static_cast<std::size_t>(at) * step;
                if (((mask[k - step] | mask[k] | mask[k + step]) & (kNoHord | kNotJudged)) != 0) continue;
                const int sign = at % 2 == 0 ? 1 : -1;
                const auto second = [&](std::int64_t a, std::int64_t b, std::int64_t c) {
                    return sign * (a - 2 * b + c);
                };
                const Deflection &a = deflections[k - step], &b = deflections[k], &c = deflections[k + step];
                x.add(second(a.x.raw(), b.x.raw(), c.x.raw()));
                y.add(second(a.y.raw(), b.y.raw(), c.y.raw()));
                light.add(second(sums[k - step], sums[k], sums[k + step]));
                light_sum += std::int64_t{sums[k - step]} + 2 * std::int64_t{sums[k]} + sums[k + step];
            }
        }
        // Of values a and -a in turn the second difference is 4 a.
        constexpr double kBin = 1 << DeflectionQ::kFractionBits;
        most.bins = std::max({most.bins, x.mean() / (4 * kBin), y.mean() / (4 * kBin)});
        if (light_sum > 0)
            most.light = std::max(most.light, light.mean() * light.count / static_cast<double>(light_sum));
    };
    const auto row = static_cast<std::size_t>(e.m);
    for (int n = 0; n < e.n; n += kAlternationBlock) {
        for (int m = 0; m < e.m; m += kAlternationBlock) {
            const int width = std::min(kAlternationBlock, e.m - m), height = std::min(kAlternationBlock, e.n - n);
            look(e.index(m, n), height, row, width, 1);
            look(e.index(m, n), width, 1, height, row);
        }
    }
    return most;
}

double undeflected_share(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                         std::span<const std::uint32_t> lenslets, double x, double y) {
    if (e.i < 9 || e.j < 9) return 0;
    return frame.bits > 8 ? undeflected<std::uint16_t>(frame, e, dark_dn, lenslets, x, y)
                          : undeflected<std::uint8_t>(frame, e, dark_dn, lenslets, x, y);
}

}  // namespace hord::algo
