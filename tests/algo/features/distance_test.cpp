#include "algo/features/distance.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr double kError = 1e-9;  // algo/features/distance.h

double measure(Feature feature, const Histogram& a, const Histogram& b, int i, int j) {
    auto distance = Distance::create(feature, i, j);
    return (*distance)(hord_of(a), hord_of(b));
}

TEST(Feature, is_found_by_the_name_it_prints) {
    for (const auto name : kFeatureNames) {
        const auto choice = feature_named(name);
        ASSERT_TRUE(choice) << name;
        EXPECT_EQ(name_of(*choice), name);
        EXPECT_FALSE(choice->against_reference);
    }
    EXPECT_EQ(feature_named("reference-chi2"), (FeatureChoice{Feature::chi2, true}));
    EXPECT_EQ(name_of(FeatureChoice{Feature::emd_l1, true}), "reference-emd-l1");
    EXPECT_FALSE(feature_named("reference-transmission"));
    EXPECT_FALSE(feature_named("emd2"));
    EXPECT_FALSE(feature_named("reference-"));
}

TEST(Distance, is_what_a_hand_computes) {
    // Half of the light moves from bin 0 to bin 4, which is (1,1).
    const Histogram a{2, 0, 0, 0, 0, 0, 0, 0, 0}, b{3, 0, 0, 0, 3, 0, 0, 0, 0};
    EXPECT_NEAR(measure(Feature::emd, a, b, 3, 3), std::sqrt(2.0) / 2, 1e-15);
    EXPECT_NEAR(measure(Feature::emd_l1, a, b, 3, 3), 1.0, 1e-15);
    EXPECT_NEAR(measure(Feature::emd_sq, a, b, 3, 3), 1.0, 1e-15);
    EXPECT_NEAR(measure(Feature::centroid, a, b, 3, 3), std::sqrt(2.0) / 2, 1e-15);
    EXPECT_NEAR(measure(Feature::marginal, a, b, 3, 3), std::sqrt(2.0) / 2, 1e-15);
    EXPECT_NEAR(measure(Feature::hellinger, a, b, 3, 3), std::sqrt(1 - std::sqrt(0.5)), 1e-15);
    EXPECT_NEAR(measure(Feature::chi2, a, b, 3, 3), (0.25 / 1.5 + 0.25 / 0.5) / 2, 1e-15);
    EXPECT_NEAR(measure(Feature::bhattacharyya, a, b, 3, 3), 0.5 * std::log(2.0), 1e-15);
}

TEST(Distance, of_disjoint_histograms_is_the_largest_and_bhattacharyya_says_that_it_saturates) {
    const Histogram a{7, 0, 0, 0, 0, 0, 0, 0, 0}, b{0, 0, 0, 0, 3, 0, 0, 0, 0};
    EXPECT_DOUBLE_EQ(measure(Feature::hellinger, a, b, 3, 3), 1.0);
    EXPECT_DOUBLE_EQ(measure(Feature::chi2, a, b, 3, 3), 1.0);
    auto bhattacharyya = Distance::create(Feature::bhattacharyya, 3, 3);
    EXPECT_EQ((*bhattacharyya)(hord_of(a), hord_of(b)), kBhattacharyyaLimit);
    EXPECT_EQ(bhattacharyya->saturated(), 1U);
    EXPECT_EQ((*bhattacharyya)(hord_of(a), hord_of(a)), 0);
    EXPECT_EQ(bhattacharyya->saturated(), 1U);
    EXPECT_NEAR(kBhattacharyyaLimit, 24 * std::log(2.0), 1e-14);
}

struct Geometry {
    int i, j;
};
class DistanceOn : public ::testing::TestWithParam<Geometry> {};

// The definitions in long double, for 8 to 16 bits and every kind of histogram.
TEST_P(DistanceOn, agrees_with_its_definition) {
    const auto [i, j] = GetParam();
    Random random(static_cast<unsigned>(100 * i + j));
    for (const int bits : {8, 10, 12, 16}) {
        const int full = (1 << bits) - 1;
        for (int n = 0; n < 30; ++n) {
            const Histogram a = n % 3 == 0 ? scattered(random, i * j, 3 * i, full) : blob(random, i, j, full, 1.0);
            Histogram b = n % 3 == 1 ? a : two_lobes(random, i, j, full);
            if (n % 3 == 1) b[static_cast<std::size_t>(pick(random, 0, i * j - 1))] ^= 1;  // 1 DN apart
            if (hord_of(b).sum == 0) b[0] = 1;
            const long double sum_a = hord_of(a).sum, sum_b = hord_of(b).sum;
            long double overlap = 0, chi2 = 0, hellinger = 0, x = 0, y = 0;
            std::vector<long double> columns(static_cast<std::size_t>(i)), lines(static_cast<std::size_t>(j));
            for (std::size_t k = 0; k < a.size(); ++k) {
                const long double h = a[k] / sum_a, g = b[k] / sum_b;
                overlap += std::sqrt(h * g);
                hellinger += (std::sqrt(h) - std::sqrt(g)) * (std::sqrt(h) - std::sqrt(g)) / 2;
                if (h + g > 0) chi2 += (h - g) * (h - g) / (h + g) / 2;
                const auto column = k % static_cast<std::size_t>(i), line = k / static_cast<std::size_t>(i);
                x += (h - g) * static_cast<long double>(column);
                y += (h - g) * static_cast<long double>(line);
                columns[column] += h - g;
                lines[line] += h - g;
            }
            const auto w1 = [](const std::vector<long double>& d) {
                long double passed = 0, sum = 0;
                for (const auto v : d) sum += std::abs(passed += v);
                return sum;
            };
            EXPECT_NEAR(measure(Feature::chi2, a, b, i, j), static_cast<double>(chi2), kError);
            EXPECT_NEAR(measure(Feature::hellinger, a, b, i, j), static_cast<double>(std::sqrt(hellinger)), kError);
            EXPECT_NEAR(measure(Feature::centroid, a, b, i, j), static_cast<double>(std::hypot(x, y)), kError);
            EXPECT_NEAR(measure(Feature::marginal, a, b, i, j), static_cast<double>(std::hypot(w1(columns), w1(lines))),
                        kError);
            if (overlap > 0) {
                EXPECT_NEAR(measure(Feature::bhattacharyya, a, b, i, j), static_cast<double>(-std::log(overlap)),
                            kError);
            }
        }
    }
}
INSTANTIATE_TEST_SUITE_P(bins, DistanceOn,
                         ::testing::Values(Geometry{3, 3}, Geometry{9, 9}, Geometry{8, 8}, Geometry{15, 15},
                                           Geometry{4, 7}, Geometry{15, 3}),
                         [](const auto& at) { return std::to_string(at.param.i) + "x" + std::to_string(at.param.j); });

// sqrt of the definition in algo/features/cramer_von_mises.h: the localised cumulative distributions on a grid of
// places, and Simpson's rule over the widths.
double cramer_von_mises_by_integration(const Histogram& a, const Histogram& b, int i, int j) {
    const double sum_a = hord_of(a).sum, sum_b = hord_of(b).sum, widest = std::max(i, j), step = 0.5;
    const auto of_width = [&](double width) {
        if (width == 0) return 0.0;
        const double reach = 5 * width, fine = std::min(step, width / 3);
        double integral = 0;
        for (double y = -reach; y <= j - 1 + reach; y += fine) {
            for (double x = -reach; x <= i - 1 + reach; x += fine) {
                double difference = 0;
                for (int k = 0; k < i * j; ++k) {
                    const auto at = static_cast<std::size_t>(k);
                    const double dx = x - k % i, dy = y - k / i;
                    difference +=
                        (a[at] / sum_a - b[at] / sum_b) * std::exp(-(dx * dx + dy * dy) / (2 * width * width));
                }
                integral += difference * difference * fine * fine;
            }
        }
        return integral / width;
    };
    constexpr int kWidths = 40;
    double sum = 0;
    for (int k = 0; k <= kWidths; ++k)
        sum += of_width(widest * k / kWidths) * (k == 0 || k == kWidths ? 1 : k % 2 == 0 ? 2 : 4);
    return std::sqrt(sum * widest / kWidths / 3);
}

TEST(Distance, cramer_von_mises_is_the_integral_over_localised_cumulative_distributions) {
    Random random(31);
    for (int n = 0; n < 3; ++n) {
        const Histogram a = scattered(random, 12, 4, 255), b = scattered(random, 12, 3, 255);
        const double expected = cramer_von_mises_by_integration(a, b, 4, 3);
        EXPECT_NEAR(measure(Feature::cramer_von_mises, a, b, 4, 3), expected, 2e-3 * expected);
    }
    // The same light moved by 1, 2 and 4 bins: it grows with the distance, where chi2 does not.
    Histogram at(81), moved(81);
    at[36] = 9;
    double before = 0;
    for (const std::size_t by : {1U, 2U, 4U}) {
        moved.assign(81, 0);
        moved[36 + by] = 9;
        const double now = measure(Feature::cramer_von_mises, at, moved, 9, 9);
        EXPECT_GT(now, 1.3 * before);
        EXPECT_EQ(measure(Feature::chi2, at, moved, 9, 9), 1);
        before = now;
    }
}

TEST(Distance, max_sliced_lies_between_the_larger_marginal_and_the_emd) {
    Random random(37);
    const double mostly = std::cos(std::acos(-1.0) / 16);  // the angle to the nearest of 8 projections
    for (int n = 0; n < 500; ++n) {
        const Histogram a = blob(random, 9, 9, 255, 0.7),
                        b = n % 2 == 0 ? two_lobes(random, 9, 9, 255) : blob(random, 9, 9, 255, 0.7);
        const double max_sliced = measure(Feature::max_sliced, a, b, 9, 9);
        ASSERT_LE(max_sliced, measure(Feature::emd, a, b, 9, 9) + kError);
        ASSERT_GE(max_sliced, mostly * measure(Feature::centroid, a, b, 9, 9) - kError);
        ASSERT_GE(max_sliced * std::sqrt(2.0), measure(Feature::marginal, a, b, 9, 9) - kError);
    }
}

TEST(Distance, bounds_nest_centroid_marginal_emd_and_sliced_emd) {
    Random random(23);
    for (int n = 0; n < 1000; ++n) {
        const Histogram a = n % 2 == 0 ? blob(random, 9, 9, 255, 0.7) : scattered(random, 81, 1 + n % 40, 255);
        const Histogram b = n % 3 == 0 ? two_lobes(random, 9, 9, 255) : scattered(random, 81, 1 + n % 9, 4095);
        const double emd = measure(Feature::emd, a, b, 9, 9);
        const double marginal = measure(Feature::marginal, a, b, 9, 9);
        ASSERT_LE(measure(Feature::centroid, a, b, 9, 9), marginal + kError);
        ASSERT_LE(marginal, emd + kError);
        ASSERT_LE(measure(Feature::sliced, a, b, 9, 9), emd + kError);
        ASSERT_GE(measure(Feature::sliced, a, b, 9, 9), 0.5 * emd / 9);  // and not trivially small
    }
}

TEST(Distance, is_symmetric_zero_for_equals_and_dark_ones_and_finite_at_the_limits) {
    Random random(29);
    const Histogram dark(225), full(225, 65535);
    Histogram one(225);
    one[224] = 1;
    for (std::size_t k = 0; k <= static_cast<std::size_t>(kLastDistance); ++k) {
        auto distance = Distance::create(static_cast<Feature>(k), 15, 15);
        ASSERT_TRUE(distance);
        for (int n = 0; n < 50; ++n) {
            const Histogram a = blob(random, 15, 15, 65535, 1.5), b = scattered(random, 225, 40, 65535);
            EXPECT_EQ((*distance)(hord_of(a), hord_of(b)), (*distance)(hord_of(b), hord_of(a)));
            EXPECT_NEAR((*distance)(hord_of(a), hord_of(a)), 0, 1e-15);
        }
        EXPECT_EQ((*distance)(hord_of(dark), hord_of(one)), 0);
        const double extreme = (*distance)(hord_of(full), hord_of(one));
        EXPECT_TRUE(std::isfinite(extreme));
        EXPECT_GT(extreme, 0.5);
    }
}

#ifdef HORD_CHECKED
// An impossible sum: more than 15x15 bins of 16 bits can hold.
TEST(DistanceDeathTest, traps_a_sum_beyond_its_range_in_the_checked_build) {
    const Histogram a(81, 65535);
    for (std::size_t k = 0; k <= static_cast<std::size_t>(kLastDistance); ++k) {
        const auto feature = static_cast<Feature>(k);
        if (feature <= Feature::emd_sq) continue;  // checked by the solver
        auto distance = Distance::create(feature, 9, 9);
        EXPECT_DEATH((void)(*distance)(Hord{a.data(), 1U << 24}, hord_of(a)), "") << name_of(feature);
    }
}
#endif

TEST(Distance, refuses_what_is_not_one) {
    EXPECT_FALSE(Distance::create(Feature::transmission, 9, 9));
    EXPECT_FALSE(Distance::create(Feature::chi2, 9, 16));
    EXPECT_TRUE(Distance::create(Feature::emd, 9, 9, {.threshold = 2.0}));
    EXPECT_FALSE(Distance::create(Feature::emd, 9, 9, {.threshold = -1.0}));
}

}  // namespace
}  // namespace hord::algo
