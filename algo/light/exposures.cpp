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

// The light of every bin of a lenslet, DN above the dark level.
template <class Sample>
class LensletLight {
  public:
    LensletLight(const FrameView& frame, const Extents& e, std::uint32_t dark_dn)
        : frame_(frame), extents_(e), dark_dn_(dark_dn) {}

    // Of lenslets[at]. Asks for the samples of those behind it: they lie far apart in memory.
    std::span<const std::uint32_t> read(std::span<const std::uint32_t> lenslets, std::size_t at) {
        constexpr std::size_t kAhead = 6;
        if (at + kAhead < lenslets.size()) {
            for (int j = 0; j < extents_.j; ++j) __builtin_prefetch(line(lenslets[at + kAhead], j));
        }
        std::uint32_t* to = light_.data();
        for (int j = 0; j < extents_.j; ++j, to += extents_.i) {
            const Sample* const samples = line(lenslets[at], j);
            for (int i = 0; i < extents_.i; ++i) to[i] = std::max<std::uint32_t>(samples[i], dark_dn_) - dark_dn_;
        }
        return std::span(light_).first(static_cast<std::size_t>(extents_.bins()));
    }

  private:
    [[nodiscard]] const Sample* line(std::uint32_t k, int j) const {
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m;
        const std::byte* const samples = frame_.data + (n * extents_.j + j) * frame_.stride_bytes;
        return reinterpret_cast<const Sample*>(samples) + m * extents_.i;
    }
    FrameView frame_;
    Extents extents_;
    std::uint32_t dark_dn_;
    std::array<std::uint32_t, kMaxBins * kMaxBins> light_{};
};

template <class Sample>
double undeflected(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets, double x, double y) {
    const double middle_i = 0.5 * (e.i - 1) + x, middle_j = 0.5 * (e.j - 1) + y;
    std::array<std::uint32_t, kMaxBins * kMaxBins> is_near{}, is_far{};  // all bits, or none
    const auto bins = static_cast<std::size_t>(e.bins());
    for (std::size_t b = 0; b < bins; ++b) {
        const int i = static_cast<int>(b) % e.i, j = static_cast<int>(b) / e.i;
        const double distance = std::max(std::abs(i - middle_i), std::abs(j - middle_j));
        is_near[b] = distance <= 1.5 ? ~0U : 0U;
        is_far[b] = distance > kFarBins ? ~0U : 0U;
    }
    LensletLight<Sample> reader(frame, e, dark_dn);
    std::array<double, kMaxFar> shares{};
    std::size_t count = 0;
    for (std::size_t at = 0; at < lenslets.size() && count < kMaxFar; ++at) {
        const std::span<const std::uint32_t> light = reader.read(lenslets, at);
        std::uint32_t sum = 0, sum_near = 0, sum_far = 0;  // below 2^24
        for (std::size_t b = 0; b < bins; ++b) {
            sum += light[b];
            sum_near += light[b] & is_near[b];
            sum_far += light[b] & is_far[b];
        }
        const double all = sum, near = sum_near, far = sum_far;
        if (far >= kFarShare * (all - near) && far >= 0.1 * all && far > 0) shares[count++] = near / all;
    }
    return count < kMinFar ? 0 : common::lower_median(std::span(shares).first(count));
}

// `sums`: light of each column or row of a lenslet.
bool is_split(std::span<const std::uint32_t> sums) {
    double all = 0;
    for (const std::uint32_t sum : sums) all += sum;
    const double outer = std::min(sums.front(), sums.back()),
                 middle = std::max(sums[(sums.size() - 1) / 2], sums[sums.size() / 2]);
    return outer > 0.1 * all && outer > 2 * middle;
}

template <class Sample>
std::size_t count_split(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                        std::span<const std::uint32_t> lenslets) {
    std::array<std::uint32_t, kMaxBins> columns{}, rows{};
    LensletLight<Sample> reader(frame, e, dark_dn);
    std::size_t split = 0;
    for (std::size_t at = 0; at < lenslets.size(); ++at) {
        const std::uint32_t* light = reader.read(lenslets, at).data();
        columns.fill(0), rows.fill(0);
        for (std::size_t j = 0; j < static_cast<std::size_t>(e.j); ++j, light += e.i) {
            for (std::size_t i = 0; i < static_cast<std::size_t>(e.i); ++i) {
                columns[i] += light[i];
                rows[j] += light[i];
            }
        }
        const bool any = is_split(std::span(columns).first(static_cast<std::size_t>(e.i))) ||
            is_split(std::span(rows).first(static_cast<std::size_t>(e.j)));
        split += any ? 1 : 0;
    }
    return split;
}

}  // namespace

double split_share(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets) {
    const std::size_t split = frame.bits > 8 ? count_split<std::uint16_t>(frame, e, dark_dn, lenslets)
                                             : count_split<std::uint8_t>(frame, e, dark_dn, lenslets);
    return lenslets.empty() ? 0 : static_cast<double>(split) / static_cast<double>(lenslets.size());
}

Alternation alternation(const Extents& e, std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                        std::span<const std::uint8_t> mask, int first_row, int last_row) {
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
    for (int n = first_row; n < last_row; n += kAlternationBlock) {
        for (int m = 0; m < e.m; m += kAlternationBlock) {
            const int width = std::min(kAlternationBlock, e.m - m), height = std::min(kAlternationBlock, last_row - n);
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
