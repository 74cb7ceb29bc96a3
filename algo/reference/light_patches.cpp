#include "algo/reference/light_patches.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/reference/edge_classes.h"

namespace hord::algo {
namespace {

constexpr int kGap = 1, kRing = 2;  // lenslets between a square and those around it that it is compared with; of these
constexpr int kMinCompared = 8;     // around it, else the square is judged alone

}  // namespace

struct LightPatches::Sums {
    double change = 0, weight = 0;
    int count = 0;
    [[nodiscard]] double mean() const { return change / weight; }
};

LightPatches::LightPatches(const Reference& reference)
    : extents_(reference.extents), change_(extents_.lenslets()), weight_(change_) {
    for (const std::int16_t edge_class : edge_classes(reference)) beside_jump_.push_back(edge_class >= 0 ? 1 : 0);
}

void LightPatches::load(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                        const Reference& reference) {
    const std::vector<float>& spread = reference.spread[static_cast<std::size_t>(Deviation::light)];
    for (std::size_t k = 0; k < change_.size(); ++k) {
        const Difference& d = differences[k];
        const bool counts = (mask[k] & (kOutside | kSaturated)) == 0 && d.has_light && beside_jump_[d.at] == 0;
        weight_[k] = counts ? 1 / (d.light_variance + spread[d.at]) : 0;
        change_[k] = counts ? weight_[k] * d.light : 0;
    }
}

void LightPatches::leave_out(float m, float n, float reach) {
    const auto first = [&](float at) { return static_cast<int>(std::floor(std::max(at - reach, 0.0F))); };
    const auto last = [&](float at, int size) { return std::min(static_cast<int>(std::ceil(at + reach)), size - 1); };
    for (int b = first(n); b <= last(n, extents_.n); ++b) {
        for (int a = first(m); a <= last(m, extents_.m); ++a) {
            if (std::hypot(static_cast<float>(a) - m, static_cast<float>(b) - n) > reach) continue;
            weight_[extents_.index(a, b)] = change_[extents_.index(a, b)] = 0;
        }
    }
}

void LightPatches::add(Sums& sums, int m, int n) const {
    const std::size_t k = extents_.index(m, n);
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

// Few squares exceed the limit by themselves: only of these the lenslets around them are read.
LightPatch LightPatches::strongest(float least) const {
    LightPatch found;
    for (const int side : kSides) {
        for (int n = 0; n + side <= extents_.n; ++n) {
            for (int m = 0; m + side <= extents_.m; ++m) {
                float change = 0, weight = 0;
                for (int b = 0; b < side; ++b) {
                    const std::size_t k = extents_.index(m, n + b);
                    for (std::size_t a = 0; a < static_cast<std::size_t>(side); ++a) change += change_[k + a];
                    for (std::size_t a = 0; a < static_cast<std::size_t>(side); ++a) weight += weight_[k + a];
                }
                const float limit = std::max(least, std::abs(found.score));
                if (!(change * change > limit * limit * weight)) continue;
                const LightPatch patch = measure(m, n, side);
                if (std::abs(patch.score) > limit) found = patch;
            }
        }
    }
    return found;
}

}  // namespace hord::algo
