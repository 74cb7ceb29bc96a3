// Trends of light, dark level and evenness over drawn frames, and the common part of both estimators of inspections.
#include "algo/ageing/light_trend.h"

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/ageing/dust.h"
#include "algo/recipe/recipe.h"
#include "tests/support/counted_heap.h"

namespace hord::algo {
namespace {

// A frame whose unlit bins read `dark` on average, and its inspection; valid until the next part.
struct Lit {
    const Frame& frame;
    Inspection inspection;
};
class Lamp {
  public:
    explicit Lamp(int bits = 8) : bits_(bits), sums_(kField.lenslets()), mask_(kField.lenslets(), kValid) {}
    double light = 1, dark = 3;
    double tile_light = 1;  // of the upper left eighth
    bool reference = false;
    Lit part() {
        if (drawn_ != std::pair(light, dark)) draw();
        const double own = 1 + 0.05 * gauss_(random_);
        for (int n = 0; n < kField.n; ++n) {
            for (int m = 0; m < kField.m; ++m) {
                sums_[static_cast<std::size_t>(n * kField.m + m)] = static_cast<std::uint32_t>(
                    10'000 * light * own * (m < kField.m / 8 && n < kField.n / 8 ? tile_light : 1) *
                    (1 + 0.05 * gauss_(random_)));
            }
        }
        Inspection inspection;
        inspection.verdict = Verdict::pass;
        inspection.sums = sums_;
        inspection.mask = mask_;
        if (reference) {
            inspection.registered.outcome = Registered::Outcome::found;
            inspection.registered.light = 0.9 * light * own;
        }
        return {frames_[next_++ % frames_.size()], inspection};
    }
    static constexpr Extents kField{32, 32, 5, 5};

  private:
    // Draws a few frames; they are used in turn.
    void draw() {
        drawn_ = {light, dark};
        const double per_dn = 1U << (bits_ - 8);
        for (Frame& frame : frames_) {
            frame = Frame(kField.width_px(), kField.height_px(), bits_);
            for (int y = 0; y < frame.height_px(); ++y) {
                for (int x = 0; x < frame.width_px(); ++x) {
                    const bool lit = std::abs(x % kField.i - 2) + std::abs(y % kField.j - 2) <= 1;
                    frame.set(x, y,
                              static_cast<std::uint32_t>(std::max(
                                  0L, std::lround(((lit ? 100 * light : 0) + dark) * per_dn + 0.8 * gauss_(random_)))));
                }
            }
        }
    }
    int bits_;
    std::vector<std::uint32_t> sums_;
    std::vector<std::uint8_t> mask_;
    std::array<Frame, 5> frames_;
    std::size_t next_ = 0;
    std::pair<double, double> drawn_{-1, -1};
    std::mt19937 random_{3};
    std::normal_distribution<double> gauss_;
};

LightAge after(LightTrend& trend, Lamp& lamp, int parts) {
    for (int k = 0; k < parts; ++k) {
        const Lit part = lamp.part();
        trend.add(part.frame.view(), part.inspection);
    }
    return trend.latest().value_or(LightAge{});
}

TEST(LightTrend, a_fading_led_is_followed_to_a_hundredth) {
    auto trend = LightTrend::create(Lamp::kField, 100);
    ASSERT_TRUE(trend);
    Lamp lamp;
    EXPECT_EQ(after(*trend, lamp, 99).parts, 0);
    LightAge age = after(*trend, lamp, 1);
    EXPECT_EQ(age.light, 1);
    EXPECT_FALSE(age.since_reference);
    lamp.light = 0.7;
    age = after(*trend, lamp, 100);
    EXPECT_NEAR(age.light, 1 - 0.3 * 0.25, 0.01) << "a quarter of the step after one window";
    age = after(*trend, lamp, 1900);
    EXPECT_NEAR(age.light, 0.7, 0.01);
    EXPECT_NEAR(age.dark_drift_dn, 0, 0.05);
    EXPECT_NEAR(age.uneven, 0, 0.02);
}

TEST(LightTrend, with_a_reference_sees_what_faded_before_the_start) {
    auto trend = LightTrend::create(Lamp::kField, 25);
    ASSERT_TRUE(trend);
    Lamp lamp;
    lamp.reference = true;
    const LightAge age = after(*trend, lamp, 25);
    EXPECT_TRUE(age.since_reference);
    EXPECT_NEAR(age.light, 0.9, 0.03);
}

TEST(LightTrend, the_dark_level_is_measured_to_a_fifth_of_a_dn_at_any_depth) {
    for (const int bits : {8, 12, 16}) {
        auto trend = LightTrend::create(Lamp::kField, 25);
        ASSERT_TRUE(trend);
        Lamp lamp(bits);
        const double scale = 1U << (bits - 8);
        EXPECT_NEAR(after(*trend, lamp, 25).dark_dn, 3 * scale, 1.5)
            << bits;  // the darkest quarter lies below the mean
        lamp.dark = 4.5;
        EXPECT_NEAR(after(*trend, lamp, 25).dark_drift_dn, 1.5 * scale, 0.2) << bits;
        lamp.dark = 2.5;
        EXPECT_NEAR(after(*trend, lamp, 25).dark_drift_dn, -0.5 * scale, 0.2) << bits;
    }
}

TEST(LightTrend, a_region_that_darkens_is_named_with_its_place) {
    auto trend = LightTrend::create(Lamp::kField, 50);
    ASSERT_TRUE(trend);
    Lamp lamp;
    after(*trend, lamp, 50);
    lamp.tile_light = 0.75;
    const LightAge age = after(*trend, lamp, 50 * 20);
    EXPECT_NEAR(age.uneven, -0.25, 0.02);
    EXPECT_NEAR(age.uneven_m, 1.5, 0.01);
    EXPECT_NEAR(age.uneven_n, 1.5, 0.01);
    EXPECT_NEAR(age.light, 1, 0.02);
    trend->restart();
    EXPECT_FALSE(trend->latest());
    EXPECT_NEAR(after(*trend, lamp, 50).uneven, 0, 1e-6) << "the first window is the measure";
}

TEST(LightTrend, parts_that_could_not_be_judged_do_not_count) {
    auto trend = LightTrend::create(Lamp::kField, 25);
    ASSERT_TRUE(trend);
    Lamp lamp;
    for (int k = 0; k < 60; ++k) {
        Lit part = lamp.part();
        part.inspection.verdict = Verdict::unfit;
        EXPECT_FALSE(trend->add(part.frame.view(), part.inspection));
    }
    EXPECT_FALSE(trend->latest());
}

TEST(Ageing, nothing_allocates_after_set_up_and_impossible_windows_are_refused) {
    EXPECT_FALSE(LightTrend::create(Lamp::kField, 0));
    EXPECT_FALSE(LightTrend::create(Lamp::kField, 100'000));
    EXPECT_FALSE(DustEstimator::create(Lamp::kField, 5));
    EXPECT_FALSE(DustEstimator::create({0, 3, 5, 5}, 100));
    auto trend = LightTrend::create(Lamp::kField, 25);
    auto dust = DustEstimator::create(Lamp::kField, 25);
    ASSERT_TRUE(trend && dust);
    Lamp lamp;
    const Lit part = lamp.part();
    EXPECT_EQ(test::allocated_by([&] {
                  for (int k = 0; k < 60; ++k) {
                      trend->add(part.frame.view(), part.inspection);
                      dust->add(part.inspection);
                  }
              }),
              0U);
    EXPECT_TRUE(trend->latest() && dust->latest());
}

// The smallest light fields.
TEST(Ageing, works_on_fields_of_three_lenslets) {
    const Extents tiny{3, 3, 3, 3};
    auto trend = LightTrend::create(tiny, 25);
    auto dust = DustEstimator::create(tiny, 25);
    ASSERT_TRUE(trend && dust);
    const Frame frame(9, 9, 8);
    const std::vector<std::uint32_t> sums{100, 100, 100, 100, 50, 100, 100, 100, 100};
    const std::vector<std::uint8_t> mask(9, kValid);
    Inspection inspection;
    inspection.verdict = Verdict::pass;
    inspection.sums = sums;
    inspection.mask = mask;
    for (int k = 0; k < 25; ++k) {
        trend->add(frame.view(), inspection);
        dust->add(inspection);
    }
    EXPECT_EQ(trend->latest()->light, 1);
    ASSERT_TRUE(dust->latest());
    EXPECT_EQ(dust->latest()->specks, 1U);
}

}  // namespace
}  // namespace hord::algo
