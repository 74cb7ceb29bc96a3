// Drift of the grid from production frames: detected in time, measured, without false alarms.
#include "algo/ageing/drift.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "common/frame.h"

namespace hord::algo {
namespace {

constexpr Extents kExtents{36, 30, 9, 9};
constexpr LightLevels kLevels{3, 16, 255};

struct Moved {
    double x = 0, y = 0, turn = 0, growth = 0;
};

// Frames of different parts: each a lens of another strength at another place, over the middle of the field.
class Line {
  public:
    Frame part(const Moved& moved) {
        const double lens_m = 18 + 3 * uniform(), lens_n = 15 + 3 * uniform(), strength = 0.1 + 0.03 * uniform(),
                     radius = 8 + uniform();
        return lens(moved, lens_m, lens_n, strength, radius);
    }
    Frame lens(const Moved& moved, double lens_m, double lens_n, double strength, double radius) {
        Frame frame(kExtents.width_px(), kExtents.height_px(), 8);
        for (int n = 0; n < kExtents.n; ++n) {
            for (int m = 0; m < kExtents.m; ++m) {
                const double px = (m - 17.5) * 9, py = (n - 14.5) * 9;
                double dx = moved.x + moved.growth * px - moved.turn * py;
                double dy = moved.y + moved.turn * px + moved.growth * py;
                if (std::hypot(m - lens_m, n - lens_n) < radius) {
                    dx += strength * (m - lens_m);
                    dy += strength * (n - lens_n);
                }
                spot(frame, m, n, dx, dy);
            }
        }
        return frame;
    }

  private:
    double uniform() { return std::uniform_real_distribution(-1.0, 1.0)(random_); }
    void spot(Frame& frame, int m, int n, double dx, double dy) {
        double across[9], down[9];
        for (int k = 0; k < 9; ++k) {
            const auto share = [k](double d) {
                return 0.5 * (std::erf((k - 3.5 - d) * 0.9) - std::erf((k - 4.5 - d) * 0.9));
            };
            across[k] = share(dx);
            down[k] = share(dy);
        }
        for (int j = 0; j < 9; ++j) {
            for (int i = 0; i < 9; ++i) {
                const double light = 400 * across[i] * down[j];  // DN; 20 electrons each
                const double noise = std::sqrt(light / 20 + 0.3) * gauss_(random_);
                frame.set(m * 9 + i, n * 9 + j,
                          static_cast<std::uint32_t>(std::clamp(std::lround(light + noise), 0L, 254L)));
            }
        }
    }
    std::mt19937 random_{7};
    std::normal_distribution<double> gauss_;
};

DriftEstimator watched(Line& line, int parts) {
    auto estimator = DriftEstimator::create(kExtents, kLevels);
    for (int k = 0; k < parts; ++k) estimator->add(line.part({}).view(), kLevels.dark);
    return std::move(*estimator);
}

TEST(Drift, a_tenth_of_a_pixel_is_measured_within_fifty_parts) {
    for (const Moved moved :
         {Moved{0.1, 0, 0, 0}, Moved{0.06, -0.08, 0, 0}, Moved{0, 0, 5e-4, 0}, Moved{0, 0, 0, -5e-4}}) {
        Line line;
        DriftEstimator estimator = watched(line, 33);  // the shift begins inside a window
        for (int k = 0; k < 50; ++k) estimator.add(line.part(moved).view(), kLevels.dark);
        ASSERT_TRUE(estimator.latest());
        const Drift& drift = *estimator.latest();
        // 9 bins and the dark level truncate the spot, so its mean moves less than the spot: 10 % is allowed.
        EXPECT_NEAR(drift.shift_x_bins, moved.x, 0.01);
        EXPECT_NEAR(drift.shift_y_bins, moved.y, 0.01);
        EXPECT_NEAR(drift.turn_rad, moved.turn, 5e-5);
        EXPECT_NEAR(drift.growth, moved.growth, 5e-5);
        EXPECT_GT(drift.largest_bins, 0.08);
        EXPECT_GT(drift.largest_bins, 3 * drift.noise_bins);
    }
}

// What the inspection subtracts, or the mean moves much less than the light.
TEST(Drift, is_the_same_on_a_pedestal_that_the_inspection_subtracts) {
    for (const std::uint32_t pedestal : {0U, 6U}) {
        Line line;
        const auto part = [&](const Moved& moved) {
            Frame frame = line.part(moved);
            for (int y = 0; y < frame.height_px(); ++y) {
                for (int x = 0; x < frame.width_px(); ++x)
                    frame.set(x, y, std::min(frame.view().sample(x, y) + pedestal, 254U));
            }
            return frame;
        };
        auto estimator = DriftEstimator::create(kExtents, kLevels);
        for (int k = 0; k < 33; ++k) estimator->add(part({}).view(), kLevels.dark + pedestal);
        for (int k = 0; k < 50; ++k) estimator->add(part({0.1, 0, 0, 0}).view(), kLevels.dark + pedestal);
        ASSERT_TRUE(estimator->latest());
        EXPECT_NEAR(estimator->latest()->shift_x_bins, 0.1, 0.01) << pedestal;
    }
}

TEST(Drift, parts_that_come_and_go_are_not_taken_for_drift) {
    Line line;
    DriftEstimator estimator = watched(line, 25);
    for (int k = 0; k < 200; ++k) {
        if (estimator.add(line.part({}).view(), kLevels.dark)) {
            EXPECT_LT(estimator.latest()->largest_bins, 0.03);
        }
    }
}

TEST(Drift, nothing_is_said_before_there_is_something_to_compare_with) {
    Line line;
    DriftEstimator estimator = watched(line, 49);
    EXPECT_FALSE(estimator.latest());
    EXPECT_TRUE(estimator.add(line.part({}).view(), kLevels.dark));
    EXPECT_TRUE(estimator.latest());
}

TEST(Drift, dark_frames_do_not_count) {
    Line line;
    DriftEstimator estimator = watched(line, 49);
    const Frame dark(kExtents.width_px(), kExtents.height_px(), 8);
    for (int k = 0; k < 60; ++k) EXPECT_FALSE(estimator.add(dark.view(), kLevels.dark));
    EXPECT_TRUE(estimator.add(line.part({}).view(), kLevels.dark));
    EXPECT_LT(estimator.latest()->largest_bins, 0.03);
}

// -- against the calibration

DriftEstimator calibrated() { return std::move(*DriftEstimator::create(kExtents, kLevels, DriftZero::calibration)); }

TEST(DriftSinceCalibration, is_measured_from_the_first_window_on_whatever_had_moved_before) {
    for (const Moved moved :
         {Moved{}, Moved{0.1, 0, 0, 0}, Moved{0.06, -0.08, 0, 0}, Moved{0, 0, 5e-4, 0}, Moved{0, 0, 0, -5e-4}}) {
        Line line;
        DriftEstimator estimator = calibrated();
        for (int k = 0; k < 24; ++k) EXPECT_FALSE(estimator.add(line.part(moved).view(), kLevels.dark));
        ASSERT_TRUE(estimator.add(line.part(moved).view(), kLevels.dark));
        const Drift& drift = *estimator.latest();
        EXPECT_TRUE(drift.since_calibration);
        EXPECT_NEAR(drift.shift_x_bins, moved.x, 0.01);
        EXPECT_NEAR(drift.shift_y_bins, moved.y, 0.01);
        EXPECT_NEAR(drift.turn_rad, moved.turn, 5e-5);
        EXPECT_NEAR(drift.growth, moved.growth, 5e-5);
    }
}

// A lens deflects like a grid that has grown: light that every part deflects alike is not free light.
TEST(DriftSinceCalibration, identical_parts_are_not_taken_for_it) {
    Line line;
    DriftEstimator estimator = calibrated();
    for (int k = 0; k < 50; ++k) estimator.add(line.lens({0.1, 0, 0, 0}, 17.5, 14.5, 0.02, 14).view(), kLevels.dark);
    ASSERT_TRUE(estimator.latest());
    EXPECT_TRUE(estimator.latest()->since_calibration);
    EXPECT_NEAR(estimator.latest()->shift_x_bins, 0.1, 0.01);
    EXPECT_NEAR(estimator.latest()->shift_y_bins, 0, 0.01);
    EXPECT_NEAR(estimator.latest()->growth, 0, 1e-4);
}

TEST(DriftSinceCalibration, parts_that_fill_the_field_are_compared_with_the_first_of_them) {
    Line line;
    DriftEstimator estimator = calibrated();
    for (int k = 0; k < 25; ++k) estimator.add(line.lens({}, 17.5, 14.5, 0.1, 60).view(), kLevels.dark);
    EXPECT_FALSE(estimator.latest());
    for (int k = 0; k < 25; ++k) estimator.add(line.lens({0.1, 0, 0, 0}, 17.5, 14.5, 0.1, 60).view(), kLevels.dark);
    ASSERT_TRUE(estimator.latest());
    EXPECT_FALSE(estimator.latest()->since_calibration);
    EXPECT_NEAR(estimator.latest()->shift_x_bins, 0.1, 0.01);
}

}  // namespace
}  // namespace hord::algo
