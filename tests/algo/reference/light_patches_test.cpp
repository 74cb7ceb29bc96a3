// Squares of lenslets whose light changed: on drawn fields of changes, with noise of 2 %.
#include "algo/reference/light_patches.h"

#include <algorithm>
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
Field field(const Extents& extents, std::uint64_t seed, const std::function<double(int, int)>& change,
            double spread = 0, bool edges = false) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal(0, kSigma);
    Field f{std::vector<Difference>(extents.lenslets()), std::vector<std::uint8_t>(extents.lenslets(), kValid), {}};
    Reference& r = f.reference;
    r.extents = extents;
    for (auto& map : r.spread) map.assign(extents.lenslets(), static_cast<float>(spread * spread));
    r.mask = f.mask;
    r.x.assign(extents.lenslets(), 0), r.y = r.x;
    for (std::size_t k = 0; k < extents.lenslets(); ++k) r.light.push_back(edges && k % 3 == 0 ? 1000 : 2000);
    for (std::size_t k = 0; k < f.differences.size(); ++k) {
        const int m = static_cast<int>(k) % extents.m, n = static_cast<int>(k) / extents.m;
        Difference& d = f.differences[k];
        d.has_light = true;
        d.at = static_cast<std::uint32_t>(k);
        d.light = static_cast<float>(normal(random) + change(m, n));
        d.light_variance = static_cast<float>(kSigma * kSigma);
    }
    return f;
}
Field field(std::uint64_t seed, const std::function<double(int, int)>& change, double spread = 0, bool edges = false) {
    return field(kField, seed, change, spread, edges);
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

// The strongest square, from sums of double, lenslet by lenslet.
LightPatch plain_strongest(const Field& f, float least) {
    const Extents& e = f.reference.extents;
    struct Sums {
        double change = 0, weight = 0;
        int count = 0;
    };
    LightPatch found;
    for (const int side : LightPatches::kSides) {
        for (int n = 0; n + side <= e.n; ++n) {
            for (int m = 0; m + side <= e.m; ++m) {
                Sums inside, around;
                for (int b = std::max(n - 3, 0); b < std::min(n + side + 3, e.n); ++b) {
                    for (int a = std::max(m - 3, 0); a < std::min(m + side + 3, e.m); ++a) {
                        const auto off = [&](int by) {
                            return a >= m - by && a < m + side + by && b >= n - by && b < n + side + by;
                        };
                        const std::size_t k = e.index(a, b);
                        if ((off(1) && !off(0)) || (f.mask[k] & kOutside) != 0) continue;
                        Sums& sums = off(0) ? inside : around;
                        const double weight = 1 / static_cast<double>(f.differences[k].light_variance);
                        sums.weight += weight;
                        sums.change += weight * static_cast<double>(f.differences[k].light);
                        ++sums.count;
                    }
                }
                if (inside.count == 0) continue;
                const double change = inside.change / inside.weight;
                double score = change * std::sqrt(inside.weight);
                if (around.count >= 8) {
                    const double beside =
                        (change - around.change / around.weight) / std::sqrt(1 / inside.weight + 1 / around.weight);
                    if ((beside > 0) != (score > 0)) score = 0;
                    else if (std::abs(beside) < std::abs(score)) score = beside;
                }
                if (std::abs(score) <= static_cast<double>(std::max(least, std::abs(found.score)))) continue;
                const float half = 0.5F * static_cast<float>(side - 1);
                found = {static_cast<float>(score), static_cast<float>(change), static_cast<float>(m) + half,
                         static_cast<float>(n) + half, side};
            }
        }
    }
    return found;
}

// Of fields narrower than a square to some blocks of squares and one more.
TEST(LightPatches, are_those_of_plain_sums) {
    int found = 0;
    for (const int columns : {1, 2, 3, 4, 5, 6, 15, 16, 17, 19, 20, 21, 32, 33, 36, 37, 48}) {
        for (std::uint64_t seed = 0; seed < 12; ++seed) {
            Field f = field({columns, 4 + static_cast<int>(seed), 9, 9}, seed,
                            [&](int m, int n) { return seed % 3 == 0 && m >= columns - 2 && n > 2 ? 4 * kSigma : 0; });
            std::mt19937_64 random(seed);
            for (std::size_t k = 0; k < f.mask.size(); ++k) {
                f.differences[k].light_variance *= 1 + static_cast<float>(random() % 4);
                if (random() % 8 == 0) f.mask[k] = kOutside;
            }
            const LightPatch patch = f.strongest(2), plain = plain_strongest(f, 2);
            EXPECT_NEAR(patch.score, plain.score, 1e-5 * std::abs(static_cast<double>(plain.score))) << columns;
            EXPECT_NEAR(patch.change, plain.change, 1e-5 * std::abs(static_cast<double>(plain.change))) << columns;
            EXPECT_EQ(patch.m, plain.m) << columns << ' ' << seed;
            EXPECT_EQ(patch.n, plain.n) << columns << ' ' << seed;
            EXPECT_EQ(patch.side, plain.side) << columns << ' ' << seed;
            found += patch.side > 0 ? 1 : 0;
        }
    }
    EXPECT_GT(found, 100);  // of 204
}

}  // namespace
}  // namespace hord::algo
