// Squares of lenslets whose light changed: on drawn fields of changes, with noise of 2 %.
#include "algo/reference/light_patches.h"

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr Extents kField{37, 41, 9, 9};
constexpr double kSigma = 0.02;

struct Field {
    std::vector<Difference> differences;
    std::vector<std::uint8_t> mask;
    Reference reference;

    [[nodiscard]] LightPatch strongest(float least = 3) const {
        LightPatches patches(reference);
        patches.load(differences, mask, reference);
        return patches.strongest(least);
    }
};

// `change(m, n)`: of the light, beside the noise.
Field field(std::uint64_t seed, const std::function<double(int, int)>& change, double spread = 0, bool edges = false) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal(0, kSigma);
    Field f{std::vector<Difference>(kField.lenslets()), std::vector<std::uint8_t>(kField.lenslets(), kValid), {}};
    Reference& r = f.reference;
    r.extents = kField;
    for (auto& map : r.spread) map.assign(kField.lenslets(), static_cast<float>(spread * spread));
    r.mask = f.mask;
    r.x.assign(kField.lenslets(), 0), r.y = r.x;
    for (std::size_t k = 0; k < kField.lenslets(); ++k) r.light.push_back(edges && k % 3 == 0 ? 1000 : 2000);
    for (std::size_t k = 0; k < f.differences.size(); ++k) {
        const int m = static_cast<int>(k) % kField.m, n = static_cast<int>(k) / kField.m;
        Difference& d = f.differences[k];
        d.has_light = true;
        d.at = static_cast<std::uint32_t>(k);
        d.light = static_cast<float>(normal(random) + change(m, n));
        d.light_variance = static_cast<float>(kSigma * kSigma);
    }
    return f;
}
double none(int, int) { return 0; }
std::function<double(int, int)> disc(double by, double radius = 1.6) {
    return [=](int m, int n) { return std::hypot(m - 20, n - 12) < radius ? by : 0; };
}

TEST(LightPatches, tell_where_light_is_more_or_less_than_expected) {
    for (const double by : {4 * kSigma, -4 * kSigma}) {
        for (std::uint64_t seed = 0; seed < 20; ++seed) {
            const LightPatch patch = field(seed, disc(by)).strongest();
            EXPECT_GT(std::copysign(1.0, by) * static_cast<double>(patch.score), 8) << seed;
            EXPECT_NEAR(patch.change, by, 1.5 * kSigma);
            EXPECT_NEAR(patch.m, 20, 1);
            EXPECT_NEAR(patch.n, 12, 1);
        }
    }
}

// One of 10,000 fields reaches 5.7 standard deviations.
TEST(LightPatches, of_noise_stay_small) {
    for (std::uint64_t seed = 100; seed < 300; ++seed)
        EXPECT_LT(std::abs(field(seed, none).strongest().score), 5.7F) << seed;
}

TEST(LightPatches, do_not_tell_of_light_that_changes_smoothly) {
    const auto lamp = [](int m, int n) { return 0.002 * (m - 18) + 0.001 * (n - 20); };
    for (std::uint64_t seed = 0; seed < 20; ++seed)
        EXPECT_LT(std::abs(field(seed, lamp).strongest().score), 5.7F) << seed;
}

// There all lenslets deviate alike, by where the part lies.
TEST(LightPatches, beside_edges_do_not_count) {
    const Field beside = field(1, disc(8 * kSigma), 0, true);
    EXPECT_EQ(beside.strongest().score, 0);
    EXPECT_GT(field(1, disc(8 * kSigma)).strongest().score, 16);
}

TEST(LightPatches, of_parts_that_spread_score_less) {
    const float score = field(1, disc(8 * kSigma)).strongest().score,
                of_spread = field(1, disc(8 * kSigma), 2 * kSigma).strongest().score;
    EXPECT_NEAR(of_spread, score / std::sqrt(5.0F), 0.1);
}

TEST(LightPatches, lenslets_that_are_left_out_outside_or_saturated_do_not_count) {
    Field f = field(1, disc(10 * kSigma));
    LightPatches patches(f.reference);
    patches.load(f.differences, f.mask, f.reference);
    patches.leave_out(20, 12, 2);
    EXPECT_LT(std::abs(patches.strongest(3).score), 5.7F);
    for (int n = 10; n <= 14; ++n) {
        for (int m = 18; m <= 22; ++m) f.mask[kField.index(m, n)] = m % 2 == 0 ? kOutside : kSaturated;
    }
    EXPECT_LT(std::abs(f.strongest().score), 5.7F);
}

}  // namespace
}  // namespace hord::algo
