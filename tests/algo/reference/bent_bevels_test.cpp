// Plates whose bevels bend light within the bins: their edges change no light, but the gradients.
#include <array>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr double kBevel = 1.5, kBend = 2.5;  // lenslets; bins, away from the plate's middle
constexpr int kPoints = 7;                   // a side of a lenslet

enum Region { kClear, kRight, kLeft, kBelow, kAbove, kOpaque, kRegions };

// Of a plate of 30x23 lenslets, lenslets from its middle; with a speck of radius 0.5 or none.
Region region_of(double x, double y, const std::optional<Pose>& speck) {
    const double to_x = 15 - std::abs(x), to_y = 11.5 - std::abs(y);
    if (speck && std::hypot(x - speck->x, y - speck->y) < 0.5) return kOpaque;
    if (std::min(to_x, to_y) < 0 || std::min(to_x, to_y) > kBevel) return kClear;
    if (to_x < to_y) return x > 0 ? kRight : kLeft;
    return y > 0 ? kBelow : kAbove;
}

Frame plate(const Pose& pose, std::uint64_t seed, double light, const std::optional<Pose>& speck = std::nullopt) {
    constexpr std::array<Spot, kOpaque> kSpots{Spot{0, 0, 1}, Spot{kBend, 0, 1}, Spot{-kBend, 0, 1}, Spot{0, kBend, 1},
                                               Spot{0, -kBend, 1}};
    const PoseMap map(pose, kPlateField);
    std::vector<std::array<double, kRegions>> shares(kPlateField.lenslets());
    for (std::size_t k = 0; k < shares.size(); ++k) {
        const int m = static_cast<int>(k) % kPlateField.m, n = static_cast<int>(k) / kPlateField.m;
        for (int t = 0; t < kPoints * kPoints; ++t) {
            const auto at = map.to_reference(m + (t % kPoints - kPoints / 2) / double{kPoints},
                                             n + (t / kPoints - kPoints / 2) / double{kPoints});
            shares[k][region_of(at.m - 30, at.n - 30, speck)] += 1.0 / (kPoints * kPoints);
        }
    }
    const double full_bin = kElectrons / (1.22 * 1.22);
    std::optional<Frame> sum;
    for (std::size_t region = 0; region < kOpaque; ++region) {
        Frame one = drawn(kPlateField, kBits, full_bin, [&](int m, int n) {
            Spot spot = kSpots[region];
            spot.light = shares[kPlateField.index(m, n)][region];
            return spot;
        });
        for (int y = 0; sum && y < one.height_px(); ++y) {
            for (int x = 0; x < one.width_px(); ++x) one.set(x, y, one.view().sample(x, y) + sum->view().sample(x, y));
        }
        sum = std::move(one);
    }
    return seen(*sum, seed, light);
}

TEST(BentBevels, good_plates_pass_wherever_the_bevels_lie_in_a_lenslet) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> near(-0.5, 0.5), turn(-0.0175, 0.0175), inside(-9, 9);
    const auto pose = [&] {
        const double x = near(random), y = near(random);
        return Pose{x, y, turn(random)};
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(plate(pose(), k, 1));
    auto all = learn_plates(frames);
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_TRUE(all->left_out.empty());
    Recipe with = recipe();
    with.reference = std::make_shared<Reference>(std::move(all->reference));
    for (std::uint64_t k = 0; k < 8; ++k) {
        const double light = k % 2 == 0 ? 1 : 0.25;
        EXPECT_EQ(judge(plate(pose(), 100 + k, light), with).verdict, Verdict::pass) << k;
        // One lenslet off a bevel, on either side.
        const double off = (k % 4 < 2 ? 1 : -1) * (15 - kBevel - 1);
        EXPECT_EQ(judge(plate(pose(), 200 + k, light, Pose{off, 0.8 * inside(random), 0}), with).verdict,
                  Verdict::reject)
            << k;
    }
}

}  // namespace
}  // namespace hord::algo
