// Specks on the optics, found from inspections of drawn parts.
#include "algo/ageing/dust.h"

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/recipe/recipe.h"

namespace hord::algo {
namespace {

constexpr double kNoiseAt500Electrons = 0.045;

struct Spot {
    double m = 0, n = 0, radius = 0.5;
    double takes = 0.5;  // share of the light that it absorbs
};

// Inspections of drawn parts: each with its own pose, slope of light and photon noise; some have a flaw.
class Line {
  public:
    explicit Line(const Extents& extents = {64, 48, 5, 5})
        : extents_(extents), sums_(extents.lenslets()), mask_(extents.lenslets()), surprise_(extents.lenslets()) {}

    double noise = kNoiseAt500Electrons;
    double flawed = 0;                                 // share of the parts
    double flaw_m = -1, flaw_n = -1, flaw_within = 0;  // where: anywhere, or within flaw_within of a place
    bool flaw_fixed = false;                           // at the same place of every part
    bool reference = false;
    double moves = 0;  // standard deviation of the part's position along each axis, lenslets
    std::vector<Spot> dust;

    Inspection part() {
        const double by_m = 0.1 * normal(), by_n = 0.1 * normal(), bow = 0.1 * normal();
        const double x = moves * normal(), y = moves * normal();
        std::vector<Spot> spots = dust;
        defects_.clear();
        if (uniform() < flawed) {
            Spot flaw{uniform() * extents_.m, uniform() * extents_.n, 0.5 + 2.5 * uniform(), 0.2 + 0.8 * uniform()};
            if (flaw_within > 0)
                flaw.m = flaw_m + flaw_within * (2 * uniform() - 1),
                flaw.n = flaw_n + flaw_within * (2 * uniform() - 1);
            if (flaw_fixed) flaw = {flaw_m + x, flaw_n + y, 1.5, 0.6};
            spots.push_back(flaw);
            if (uniform() < 0.5) {  // the inspection finds it
                Defect defect;
                defect.m = static_cast<float>(flaw.m);
                defect.n = static_cast<float>(flaw.n);
                defect.area = static_cast<std::uint32_t>(3.15 * flaw.radius * flaw.radius) + 1;
                defects_.push_back(defect);
            }
        }
        std::size_t k = 0;
        for (int n = 0; n < extents_.n; ++n) {
            for (int m = 0; m < extents_.m; ++m, ++k) {
                const double u = 2.0 * m / extents_.m - 1, v = 2.0 * n / extents_.n - 1;
                double passes = 1;
                for (const Spot& spot : spots) {
                    if (std::hypot(m - spot.m, n - spot.n) <= spot.radius) passes *= 1 - spot.takes;
                }
                const double light = (1 + by_m * u + by_n * v + bow * u * v) * passes;
                const double error = noise * normal();
                sums_[k] = static_cast<std::uint32_t>(std::max(0.0, 10'000 * light * (1 + error)));
                surprise_[k] = static_cast<float>(std::abs((1 - passes) / noise + normal()));
                mask_[k] = m == 0 || n == 0 || m == extents_.m - 1 || n == extents_.n - 1 ? kRim : kValid;
            }
        }
        Inspection inspection;
        inspection.verdict = defects_.empty() ? Verdict::pass : Verdict::reject;
        inspection.reason = Reason::none;
        inspection.sums = sums_;
        inspection.mask = mask_;
        inspection.defects = defects_;
        if (reference) {
            inspection.z_score = surprise_;
            inspection.registered.outcome = Registered::Outcome::found;
            inspection.registered.pose = {x, y, 0};
        }
        return inspection;
    }
    [[nodiscard]] const Extents& extents() const { return extents_; }
    double uniform() { return std::uniform_real_distribution<double>()(random_); }

  private:
    double normal() { return gauss_(random_); }
    Extents extents_;
    std::vector<std::uint32_t> sums_;
    std::vector<std::uint8_t> mask_;
    std::vector<float> surprise_;
    std::vector<Defect> defects_;
    std::mt19937_64 random_{20};
    std::normal_distribution<double> gauss_;
};

DustEstimator dust_of(const Line& line, int window = 100) {
    return std::move(*DustEstimator::create(line.extents(), window));
}

// Number of parts until the estimator first reports `specks` or more; 0: not within `most` parts.
int parts_until(DustEstimator& estimator, Line& line, bool specks, int most) {
    for (int k = 1; k <= most; ++k) {
        if (estimator.add(line.part()) && (estimator.latest()->specks > 0) == specks) return k;
    }
    return 0;
}

TEST(Dust, ten_thousand_parts_with_flaws_of_their_own_raise_no_alarm) {
    Line line({32, 32, 5, 5});
    line.flawed = 0.5;
    DustEstimator hundred = dust_of(line), shortest = dust_of(line, DustEstimator::kMinWindow);
    int windows = 0, alarms = 0;
    for (int k = 0; k < 10'000; ++k) {
        const Inspection part = line.part();
        for (DustEstimator* estimator : {&hundred, &shortest}) {
            if (!estimator->add(part)) continue;
            ++windows;
            alarms += estimator->latest()->specks > 0 ? 1 : 0;
        }
    }
    EXPECT_EQ(windows, 500);
    EXPECT_EQ(alarms, 0);
}

TEST(Dust, flaws_that_are_frequent_in_one_region_raise_none) {
    Line line({40, 32, 5, 5});
    line.flawed = 0.9;
    line.flaw_m = 25, line.flaw_n = 15, line.flaw_within = 4;
    DustEstimator estimator = dust_of(line);
    EXPECT_EQ(parts_until(estimator, line, true, 2000), 0);
}

TEST(Dust, that_takes_a_sixth_of_a_lenslet_is_named_within_two_windows_with_its_place_and_is_over_after_cleaning) {
    Line line;
    line.flawed = 0.3;
    DustEstimator estimator = dust_of(line);
    for (int k = 0; k < 150; ++k) estimator.add(line.part());
    ASSERT_EQ(estimator.latest()->specks, 0U);
    line.dust = {{23, 31, 0.4, 1.0 / 6}};
    const int named = parts_until(estimator, line, true, 1000);
    EXPECT_GT(named, 0);
    EXPECT_LE(named, 200);
    const DustFound& found = *estimator.latest();
    EXPECT_EQ(found.specks, 1U);
    EXPECT_NEAR(found.largest[0].m, 23, 0.1);
    EXPECT_NEAR(found.largest[0].n, 31, 0.1);
    EXPECT_EQ(found.largest[0].lenslets, 1U);
    EXPECT_GT(found.largest[0].share, 0.6F);
    line.dust.clear();
    const int over = parts_until(estimator, line, false, 1000);
    EXPECT_GT(over, 0);
    EXPECT_LE(over, 200);
}

TEST(Dust, several_specks_are_listed_largest_first) {
    Line line;
    line.dust = {{10, 10, 0.5, 0.5}, {40.5, 20, 2.5, 0.9}, {20, 40, 1.2, 0.4}};
    DustEstimator estimator = dust_of(line);
    ASSERT_EQ(parts_until(estimator, line, true, 100), 100);
    const DustFound& found = *estimator.latest();
    ASSERT_EQ(found.specks, 3U);
    EXPECT_NEAR(found.largest[0].m, 40.5, 0.2);
    EXPECT_NEAR(found.largest[0].n, 20, 0.2);
    EXPECT_NEAR(found.largest[1].m, 20, 0.2);
    EXPECT_NEAR(found.largest[2].n, 10, 0.1);
    EXPECT_FALSE(found.pose_spread);
}

TEST(Dust, more_specks_than_are_listed_are_counted) {
    Line line;
    for (int k = 0; k < 12; ++k) line.dust.push_back({5.0 + 15 * (k % 4), 8.0 + 15 * (k / 4), k == 7 ? 1.5 : 0.5, 0.6});
    DustEstimator estimator = dust_of(line);
    ASSERT_EQ(parts_until(estimator, line, true, 100), 100);
    EXPECT_EQ(estimator.latest()->specks, 12U);
    EXPECT_NEAR(estimator.latest()->largest[0].m, 50, 0.1);
    EXPECT_NEAR(estimator.latest()->largest[0].n, 23, 0.1);
    for (const Speck& speck : estimator.latest()->largest) EXPECT_GT(speck.lenslets, 0U);
}

TEST(Dust, that_lies_opaque_on_a_lenslet_is_found_though_there_is_no_light_left) {
    Line line;
    line.dust = {{30, 30, 1, 1}};
    DustEstimator estimator = dust_of(line);
    bool closed = false;
    for (int k = 0; k < 100; ++k) {
        Inspection part = line.part();
        std::vector<std::uint8_t> mask(part.mask.begin(), part.mask.end());
        for (std::size_t at = 0; at < mask.size(); ++at)
            mask[at] = static_cast<std::uint8_t>(mask[at] | (part.sums[at] == 0 ? kDark : 0));
        part.mask = mask;
        closed = estimator.add(part);
    }
    ASSERT_TRUE(closed);
    ASSERT_EQ(estimator.latest()->specks, 1U);
    EXPECT_EQ(estimator.latest()->largest[0].lenslets, 5U);
    EXPECT_EQ(estimator.latest()->largest[0].share, 1.0F);
}

TEST(Dust, with_a_reference_is_told_from_a_flaw_of_every_part_once_the_parts_move) {
    Line still;
    still.reference = true;
    still.flawed = 1, still.flaw_fixed = true, still.flaw_m = 20, still.flaw_n = 20;
    DustEstimator estimator = dust_of(still);
    ASSERT_EQ(parts_until(estimator, still, true, 100), 100);
    EXPECT_FALSE(estimator.latest()->largest[0].tells_apart) << "parts that all lie alike";
    EXPECT_NEAR(*estimator.latest()->pose_spread, 0, 1e-9);

    Line moving;
    moving.reference = true;
    moving.moves = 2.5;
    moving.flawed = 1, moving.flaw_fixed = true, moving.flaw_m = 20, moving.flaw_n = 20;
    DustEstimator other = dust_of(moving);
    EXPECT_EQ(parts_until(other, moving, true, 1000), 0) << "a flaw that moves with the parts is no dust";
    // Parts that move less than the flaw is wide: it is found at one place, but not reported as dust.
    for (const double moves : {0.3, 0.6, 0.9, 1.1, 1.25}) {
        Line some({56, 40, 5, 5});
        some.reference = true;
        some.moves = moves;
        some.flawed = 1, some.flaw_fixed = true, some.flaw_m = 20, some.flaw_n = 20;
        DustEstimator third = dust_of(some);
        int specks = 0;
        for (int k = 0; k < 600; ++k) {
            if (!third.add(some.part())) continue;
            specks += static_cast<int>(third.latest()->specks);
            EXPECT_FALSE(third.latest()->largest[0].tells_apart) << moves;
        }
        if (moves < 1) {
            EXPECT_GT(specks, 0) << moves;
        }
        some.flawed = 0;
        some.dust = {{45, 30, 1.2, 0.5}};
        for (int k = 0; k < 200; ++k) third.add(some.part());
        EXPECT_EQ(third.latest()->specks, 1U);
        if (moves > 0.9) {
            EXPECT_TRUE(third.latest()->largest[0].tells_apart) << moves;
        }
        if (moves < 0.4) {
            EXPECT_FALSE(third.latest()->largest[0].tells_apart) << moves;
        }
    }
    moving.dust = {{45, 30, 1.5, 0.5}};
    EXPECT_GT(parts_until(other, moving, true, 200), 0);
    ASSERT_EQ(other.latest()->specks, 1U);
    EXPECT_TRUE(other.latest()->largest[0].tells_apart);
    EXPECT_NEAR(*other.latest()->pose_spread, 2.5, 0.5);
    EXPECT_NEAR(other.latest()->largest[0].m, 45, 0.2);
}

TEST(Dust, is_not_looked_for_where_nothing_is_judged_nor_in_parts_that_could_not_be) {
    Line line;
    line.dust = {{30, 0, 0.5, 0.9}};  // on the rim
    DustEstimator estimator = dust_of(line);
    EXPECT_EQ(parts_until(estimator, line, true, 300), 0);
    line.dust = {{30, 20, 0.5, 0.9}};
    for (int k = 0; k < 300; ++k) {
        Inspection unfit = line.part();
        unfit.verdict = Verdict::unfit;
        EXPECT_FALSE(estimator.add(unfit));
    }
    estimator.restart();
    EXPECT_FALSE(estimator.latest());
    EXPECT_EQ(parts_until(estimator, line, true, 200), 100);
}

}  // namespace
}  // namespace hord::algo
