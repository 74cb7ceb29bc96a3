#include "algo/reference/light_patches.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/reference/edge_classes.h"

namespace hord::algo {
namespace {

constexpr int kGap = 1, kRing = 2;  // lenslets between a square and those around it that it is compared with; of these
constexpr int kMinCompared = 8;     // around it, else the square is judged alone
// Squares that are summed at once: so many that loops over them are vectorised.
constexpr std::size_t kBlock = 16;
// Sums of float may be off by this share of what they are compared with: 24 roundings of 6e-8 of the lenslets' changes,
// of up to 100 standard deviations each. What the sums let through is measured in double.
constexpr float kRounding = 1e-3F;

// Columns of a field and zeros, up to a full block and what its last square reads.
std::size_t padded(int columns) { return (static_cast<std::size_t>(columns) + kBlock - 1) / kBlock * kBlock + kBlock; }

// Sums over `kSide` rows.
template <int kSide>
void sum_columns(const float* rows, std::size_t pitch, std::vector<float>& sums) {
    for (std::size_t first = 0; first < pitch; first += kBlock) {
        for (std::size_t a = first; a < first + kBlock; ++a) {
            float sum = rows[a];
            for (std::size_t b = 1; b < kSide; ++b) sum += rows[b * pitch + a];
            sums[a] = sum;
        }
    }
}

// Sum over `kSide` columns.
template <int kSide>
float sum_of(const float* columns) {
    float sum = columns[0];
    for (std::size_t a = 1; a < kSide; ++a) sum += columns[a];
    return sum;
}

// Whether one of a block of squares may exceed the limit.
template <int kSide>
bool any_exceeds(const float* change, const float* weight, float squared_limit) {
    int exceeding = 0;
    for (std::size_t a = 0; a < kBlock; ++a) {
        const float by = sum_of<kSide>(change + a);
        exceeding |= by * by > squared_limit * sum_of<kSide>(weight + a) ? 1 : 0;
    }
    return exceeding != 0;
}

}  // namespace

struct LightPatches::Sums {
    double change = 0, weight = 0;
    int count = 0;
    [[nodiscard]] double mean() const { return change / weight; }
};

LightPatches::LightPatches(const Reference& reference)
    : extents_(reference.extents), pitch_(padded(extents_.m)), change_(pitch_ * static_cast<std::size_t>(extents_.n)),
      weight_(change_), change_of_columns_(pitch_), weight_of_columns_(pitch_) {
    for (const std::int16_t edge_class : edge_classes(reference)) beside_jump_.push_back(edge_class >= 0 ? 1 : 0);
}

void LightPatches::load(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                        const Reference& reference) {
    const std::vector<float>& spread = reference.spread[static_cast<std::size_t>(Deviation::light)];
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (std::size_t to = index(0, n); to < index(extents_.m, n); ++to, ++k) {
            const Difference& d = differences[k];
            const bool counts = (mask[k] & (kOutside | kSaturated)) == 0 && d.has_light && beside_jump_[d.at] == 0;
            weight_[to] = counts ? 1 / (d.light_variance + spread[d.at]) : 0;
            change_[to] = counts ? weight_[to] * d.light : 0;
        }
    }
}

void LightPatches::leave_out(float m, float n, float reach) {
    const auto first = [&](float at) { return static_cast<int>(std::floor(std::max(at - reach, 0.0F))); };
    const auto last = [&](float at, int size) { return std::min(static_cast<int>(std::ceil(at + reach)), size - 1); };
    for (int b = first(n); b <= last(n, extents_.n); ++b) {
        for (int a = first(m); a <= last(m, extents_.m); ++a) {
            if (std::hypot(static_cast<float>(a) - m, static_cast<float>(b) - n) > reach) continue;
            weight_[index(a, b)] = change_[index(a, b)] = 0;
        }
    }
}

void LightPatches::add(Sums& sums, int m, int n) const {
    const std::size_t k = index(m, n);
    if (weight_[k] == 0) return;
    sums.change += static_cast<double>(change_[k]);
    sums.weight += static_cast<double>(weight_[k]);
    ++sums.count;
}

// The square whose first lenslet is (m, n).
LightPatch LightPatches::measure(int m, int n, int side) const {
    Sums inside, around;
    constexpr int kReach = kGap + kRing;
    for (int b = std::max(n - kReach, 0); b < std::min(n + side + kReach, extents_.n); ++b) {
        for (int a = std::max(m - kReach, 0); a < std::min(m + side + kReach, extents_.m); ++a) {
            const int off = std::max({m - a, a - (m + side - 1), n - b, b - (n + side - 1)});
            if (off <= 0) add(inside, a, b);
            else if (off > kGap) add(around, a, b);
        }
    }
    const double change = inside.mean();
    double score = change * std::sqrt(inside.weight);
    if (around.count >= kMinCompared) {
        const double beside = (change - around.mean()) / std::sqrt(1 / inside.weight + 1 / around.weight);
        if ((beside > 0) != (score > 0)) score = 0;
        else if (std::abs(beside) < std::abs(score)) score = beside;
    }
    const float half = 0.5F * static_cast<float>(side - 1);
    return {static_cast<float>(score), static_cast<float>(change), static_cast<float>(m) + half,
            static_cast<float>(n) + half, side};
}

// Few squares exceed the limit by themselves: only these, and the lenslets around them, are read one by one.
template <int kSide>
void LightPatches::find_stronger(float least, LightPatch& found) {
    const float *change = change_of_columns_.data(), *weight = weight_of_columns_.data();
    const int columns = extents_.m - kSide + 1;  // of squares
    for (int n = 0; n + kSide <= extents_.n; ++n) {
        sum_columns<kSide>(&change_[index(0, n)], pitch_, change_of_columns_);
        sum_columns<kSide>(&weight_[index(0, n)], pitch_, weight_of_columns_);
        for (int first = 0; first < columns; first += static_cast<int>(kBlock)) {
            const auto squared_limit = [&] {
                const float limit = std::max(least, std::abs(found.score));
                return (1 - kRounding) * limit * limit;
            };
            if (!any_exceeds<kSide>(change + first, weight + first, squared_limit())) continue;
            for (int m = first; m < std::min(first + static_cast<int>(kBlock), columns); ++m) {
                const float by = sum_of<kSide>(change + m);
                if (!(by * by > squared_limit() * sum_of<kSide>(weight + m))) continue;
                const LightPatch patch = measure(m, n, kSide);
                if (std::abs(patch.score) > std::max(least, std::abs(found.score))) found = patch;
            }
        }
    }
}

LightPatch LightPatches::strongest(float least) {
    static_assert(std::size(kSides) == 3);
    LightPatch found;
    find_stronger<kSides[0]>(least, found);
    find_stronger<kSides[1]>(least, found);
    find_stronger<kSides[2]>(least, found);
    return found;
}

}  // namespace hord::algo
