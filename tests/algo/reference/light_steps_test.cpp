// The outline of a clear plate without bevels: a step of the light by 8 %.
#include "algo/reference/light_steps.h"

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr Extents kField{61, 61, 9, 9};
constexpr double kElectrons = 20'000;  // a lenslet of free light; a DN each
constexpr int kParts = 20, kPoints = 8;
// As those that 20 plates teach whose sizes vary by 0.05 lenslet.
constexpr std::array<float, 2> kSizeLimits{0.36F, 0.36F}, kBlurLimits{0.3F, 0.3F};

struct Plate {
    Pose pose;
    double larger = 0;  // lenslets, along x
    double moved = 0;   // lenslets, along x, while the light is on
    double passes = 0.92;
    double chip = 0;  // radius about the middle of the left side, lenslets
};

// The light of all lenslets, of the free light.
std::vector<double> light_of(const Plate& plate) {
    const PoseMap map(plate.pose, kField);
    const int exposures = plate.moved > 0 ? 16 : 1;
    std::vector<double> light;
    const double half_m = 18.15 + plate.larger / 2, half_n = 14.2;
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            double glass = 0;
            for (int t = 0; t < exposures * kPoints * kPoints; ++t) {
                const int point = t % (kPoints * kPoints), exposure = t / (kPoints * kPoints);
                const double right = plate.moved * ((exposure + 0.5) / exposures - 0.5),
                             a = (point % kPoints + 0.5) / kPoints - 0.5, b = (point / kPoints + 0.5) / kPoints - 0.5;
                const auto at = map.to_reference(m + a - right, n + b);
                const double x = at.m - 30, y = at.n - 30;
                const bool in_chip = std::hypot(x + half_m, y) < plate.chip;
                glass += std::abs(x) < half_m && std::abs(y) < half_n && !in_chip ? 1 : 0;
            }
            light.push_back(1 - (1 - plate.passes) * glass / (exposures * kPoints * kPoints));
        }
    }
    return light;
}

class Plates {
  public:
    // The mean of plates that lie within a tenth of a lenslet.
    explicit Plates(double passes = 0.92) : reference_(kField.lenslets()), mask_(kField.lenslets(), kValid) {
        for (int k = 0; k < kParts; ++k) {
            const Plate plate{{0.1 * uniform(), 0.1 * uniform(), 0.002 * uniform()}, 0, 0, passes, 0};
            const std::vector<std::uint32_t> part = expose(plate, 1);
            for (std::size_t at = 0; at < part.size(); ++at) reference_[at] += static_cast<float>(part[at]) / kParts;
        }
    }
    Plate good() { return {{0.5 * uniform(), 0.5 * uniform(), std::sin(std::numbers::pi / 180 * uniform())}}; }
    LightSteps compare(const Plate& plate, double level = 1) { return compare_at(plate.pose, plate, level); }
    LightSteps compare_at(const Pose& pose, const Plate& plate, double level = 1) {
        const std::vector<std::uint32_t> sums = expose(plate, level);
        const ReferenceMaps maps{reference_, {}, {}, mask_, kSizeLimits, kBlurLimits};
        return compare_light_steps(kField, maps, {{}, sums, mask_}, PoseMap(pose, kField), kElectrons, level);
    }

  private:
    double uniform() { return std::uniform_real_distribution<double>(-1, 1)(random_); }
    std::vector<std::uint32_t> expose(const Plate& plate, double level) {
        std::vector<std::uint32_t> sums;
        for (const double share : light_of(plate)) {
            const double mean = share * kElectrons * level;
            sums.push_back(static_cast<std::uint32_t>(
                std::lround(mean + std::sqrt(mean) * std::normal_distribution<double>()(random_))));
        }
        return sums;
    }

    std::mt19937_64 random_{4610};
    std::vector<float> reference_;
    std::vector<std::uint8_t> mask_;
};

TEST(LightSteps, of_good_plates_are_sharp_and_where_they_should_be) {
    Plates plates;
    for (const double level : {1.0, 0.5, 0.25}) {
        for (int k = 0; k < 6; ++k) {
            const LightSteps seen = plates.compare(plates.good(), level);
            for (const std::size_t axis : {0U, 1U}) {
                EXPECT_TRUE(seen.size.known[axis] && seen.blur.known[axis]);
                EXPECT_LT(std::abs(seen.size.wider[axis]), 0.3) << level;
                EXPECT_LT(seen.blur.blur[axis], 0.3) << level;
            }
            EXPECT_FALSE(seen.size.exceeds() || seen.blur.exceeds()) << level;
        }
    }
}

// Clear plates hardly tell how they are turned: their sides are sharp where they lie.
TEST(LightSteps, are_as_sharp_where_the_turn_is_not_known) {
    Plates plates;
    for (const double turn : {-1.0, -0.5, 0.5, 1.0}) {
        Plate plate = plates.good();
        plate.pose.sine = std::sin(std::numbers::pi / 180 * turn);
        const LightSteps seen = plates.compare_at({plate.pose.x, plate.pose.y, 0}, plate);
        for (const std::size_t axis : {0U, 1U}) {
            EXPECT_TRUE(seen.blur.known[axis]);
            EXPECT_LT(std::abs(seen.blur.blur[axis]), 0.1) << turn;
            EXPECT_FALSE(seen.size.exceeds(axis)) << turn;
        }
    }
}

TEST(LightSteps, tell_motion_along_the_axis_it_is_along) {
    Plates plates;
    for (const double level : {1.0, 0.25}) {
        for (const double moved : {3.0, 4.0}) {
            Plate plate = plates.good();
            plate.moved = moved;
            const LightSteps seen = plates.compare(plate, level);
            EXPECT_TRUE(seen.blur.exceeds(0)) << seen.blur.blur[0] << " of " << seen.blur.allowed[0];
            EXPECT_FALSE(seen.blur.exceeds(1)) << seen.blur.blur[1];
        }
    }
}

TEST(LightSteps, tell_another_size) {
    Plates plates;
    for (const double level : {1.0, 0.25}) {
        for (const double larger : {-2.0, -1.0, 1.0, 2.0}) {
            Plate plate = plates.good();
            plate.larger = larger;
            const LightSteps seen = plates.compare(plate, level);
            EXPECT_NEAR(seen.size.wider[0], larger, 0.2) << level;
            EXPECT_TRUE(seen.size.exceeds(0)) << level;
            EXPECT_FALSE(seen.size.exceeds(1)) << level;
        }
    }
}

TEST(LightSteps, a_chip_is_neither_motion_nor_another_size) {
    Plates plates;
    for (const double radius : {2.0, 3.0, 4.0, 5.0}) {
        for (const double level : {1.0, 0.1}) {
            Plate plate = plates.good();
            plate.chip = radius;
            const LightSteps seen = plates.compare(plate, level);
            EXPECT_FALSE(seen.size.exceeds() || seen.blur.exceeds())
                << radius << " " << level << ": " << seen.size.wider[0] << " " << seen.blur.blur[0];
        }
    }
}

// Noise alone has no steps.
TEST(LightSteps, of_a_field_without_a_part_are_not_known) {
    Plates plates(1);
    const LightSteps seen = plates.compare(plates.good());
    for (const std::size_t axis : {0U, 1U}) EXPECT_FALSE(seen.size.known[axis] || seen.blur.known[axis]);
}

}  // namespace
}  // namespace hord::algo
