#include "algo/inspection/missing_material.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kPad = 5;             // the distance of squares of 3 x 3
constexpr int kSmallestField = 11;  // blocks: of fewer no three squares fit
constexpr std::size_t kMaxSamples = 1024, kMinSamples = 32;
constexpr float kSigmasOfMedian = 1.4826F;  // of a normal distribution, by its median absolute value

// Squares of one block are two blocks apart, of 3 x 3 blocks five: one and two thirds of the side, rounded up.
int distance_of(int half) { return 3 * half + 2; }

}  // namespace

MissingMaterialFinder::Level::Level(int columns, int rows, int lenslets_a_block)
    : m(columns), n(rows), block(lenslets_a_block), stride(static_cast<std::size_t>(columns) + 2 * kPad),
      light(stride * (static_cast<std::size_t>(rows) + 2 * kPad)), count(light.size()) {}

std::size_t MissingMaterialFinder::Level::index(int column, int row) const {
    return static_cast<std::size_t>(row + kPad) * stride + static_cast<std::size_t>(column + kPad);
}

MissingMaterialFinder::MissingMaterialFinder(const Extents& extents) {
    int m = extents.m, n = extents.n, block = 1;
    do {
        levels_.emplace_back(m, n, block);
        m /= 2, n /= 2, block *= 2;
    } while (std::max(m, n) >= kSmallestField);
    for (auto* const map : {&light_, &count_, &whole_, &part_}) map->resize(levels_.front().light.size());
    excess_.resize(static_cast<std::size_t>(extents.m));
    samples_.reserve(kMaxSamples + 4);
}

std::optional<MissingMaterial> MissingMaterialFinder::find(std::span<const std::uint32_t> sums,
                                                           std::span<const std::uint8_t> mask, std::uint32_t min_area) {
    Level& lenslets = levels_.front();
    std::size_t k = 0;
    for (int n = 0; n < lenslets.n; ++n) {
        const std::size_t row = lenslets.index(0, n);
        for (std::size_t m = 0; m < static_cast<std::size_t>(lenslets.m); ++m, ++k) {
            const float counts = (mask[k] & (kDark | kNotJudged)) == 0 ? 1.0F : 0.0F;
            lenslets.light[row + m] = counts * static_cast<float>(static_cast<std::int32_t>(sums[k]));
            lenslets.count[row + m] = counts;
        }
    }
    for (std::size_t l = 1; l < levels_.size(); ++l) {
        const Level& finer = levels_[l - 1];
        Level& level = levels_[l];
        const auto halve = [&](const std::vector<float>& from, std::vector<float>& to) {
            for (int n = 0; n < level.n; ++n) {
                const float* const a = from.data() + finer.index(0, 2 * n);
                const float* const b = a + finer.stride;
                float* const out = to.data() + level.index(0, n);
                for (int m = 0; m < level.m; ++m) out[m] = a[2 * m] + a[2 * m + 1] + b[2 * m] + b[2 * m + 1];
            }
        };
        halve(finer.light, level.light);
        halve(finer.count, level.count);
    }
    MissingMaterial best;
    if (min_area <= 1) look_at(lenslets, 0, best);
    for (const Level& level : levels_) {
        const auto side = static_cast<std::uint32_t>(3 * level.block);
        if (side * side >= min_area) look_at(level, 1, best);
    }
    if (best.score < 1) return std::nullopt;
    return best;
}

// Squares of 2 * half + 1 blocks.
void MissingMaterialFinder::look_at(const Level& level, int half, MissingMaterial& best) {
    const int side = (2 * half + 1) * level.block, distance = distance_of(half);
    const auto lenslets = static_cast<float>(side) * static_cast<float>(side);
    if (half > 0) sum_squares(level);
    const std::vector<float>&light = half > 0 ? light_ : level.light, &count = half > 0 ? count_ : level.count;
    for (std::size_t k = 0; k < level.light.size(); ++k) {
        const float mean = light[k] / std::max(count[k], 1.0F);
        whole_[k] = count[k] >= lenslets ? mean : 0;
        part_[k] = count[k] >= kMinOfSideSquare * lenslets ? mean : 0;
    }
    const std::optional<float> sigma = noise(level, distance);
    if (!sigma) return;
    const float limit = std::max(kMinExcess, kMinExcessSigmas * *sigma);
    const auto above = static_cast<std::ptrdiff_t>(level.stride) * distance;
    float most = 0;
    std::size_t at = 0;
    for (int n = 0; n < level.n; ++n) {
        const std::size_t row = level.index(0, n);
        const float *const whole = whole_.data() + row, *const part = part_.data() + row;
        for (int m = 0; m < level.m; ++m) {
            const float a = part[m - distance], b = part[m + distance], c = part[m - above], d = part[m + above];
            const int there = (a > 0 ? 1 : 0) + (b > 0 ? 1 : 0) + (c > 0 ? 1 : 0) + (d > 0 ? 1 : 0);
            const float brightest = std::max(std::max(a, b), std::max(c, d));
            excess_[static_cast<std::size_t>(m)] = there >= 3 ? whole[m] / std::max(brightest, 1.0F) - 1 : 0;
        }
        for (std::size_t m = 0; m < static_cast<std::size_t>(level.m); ++m) {
            if (excess_[m] <= most) continue;
            most = excess_[m];
            at = row + m;
        }
    }
    if (most <= limit * best.score) return;
    const auto middle = [&](std::size_t block) {
        return (static_cast<float>(block) - kPad + 0.5F) * static_cast<float>(level.block) - 0.5F;
    };
    best = {middle(at % level.stride), middle(at / level.stride), side, most, most / limit};
}

// Of the 3 x 3 blocks about each.
void MissingMaterialFinder::sum_squares(const Level& level) {
    const auto sum = [&](const std::vector<float>& from, std::vector<float>& to) {
        const std::size_t stride = level.stride, last = level.light.size() - stride - 1;
        std::fill_n(to.begin(), stride + 1, 0.0F);
        std::fill_n(to.begin() + static_cast<std::ptrdiff_t>(last), stride + 1, 0.0F);
        for (std::size_t k = stride + 1; k < last; ++k) {
            const float *const a = from.data() + k - stride, *const b = from.data() + k, *const c = b + stride;
            to[k] = a[-1] + a[0] + a[1] + b[-1] + b[0] + b[1] + c[-1] + c[0] + c[1];
        }
    };
    sum(level.light, light_);
    sum(level.count, count_);
}

// Standard deviation of the relative difference of two squares, of up to kMaxSamples in places all over the part; by
// the median, so that a small hole does not add to it (a large one does, and hides itself). None if there are too few.
std::optional<float> MissingMaterialFinder::noise(const Level& level, int distance) {
    samples_.clear();
    const auto blocks = static_cast<std::size_t>(level.m) * static_cast<std::size_t>(level.n);
    const auto shift = static_cast<std::size_t>(distance), below = shift * level.stride;
    const std::size_t step = std::max<std::size_t>((2 * blocks + kMaxSamples - 1) / kMaxSamples, 1);
    for (std::size_t k = 0; k < blocks; k += step) {
        const auto row = k / static_cast<std::size_t>(level.m), column = k % static_cast<std::size_t>(level.m);
        const std::size_t at = level.index(static_cast<int>(column), static_cast<int>(row));
        if (whole_[at] <= 0) continue;
        for (const std::size_t beside : {at + shift, at + below}) {
            if (part_[beside] > 0) samples_.push_back(std::abs(whole_[at] / part_[beside] - 1));
        }
    }
    if (samples_.size() < kMinSamples) return std::nullopt;
    return kSigmasOfMedian * common::lower_median(std::span(samples_));
}

}  // namespace hord::algo
