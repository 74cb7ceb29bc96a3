// The share of a fainter copy of a spot, whose light blends with the spot's.
#include "algo/light/copied_spot.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

constexpr int kBins = 9;
constexpr double kHalfCore = 1.5;
// The largest skewness of a narrow spot that two bins share, over that of a copy two bins away: 0.096 / 8.
constexpr double kOfBins = 0.0125;

// Light of a Gaussian spot in each bin, its middle `at` bins from the first one's. What lies beyond the last bin falls
// into the first ones of the next lenslet, which shows the same.
std::vector<double> spot(double sigma, double at, double share = 1, int bins = kBins) {
    std::vector<double> axis(static_cast<std::size_t>(bins));
    const auto before = [&](double x) { return 0.5 * std::erf((x - at) / sigma / std::sqrt(2.0)); };
    for (int k = -bins; k < 2 * bins; ++k)
        axis[static_cast<std::size_t>((k + bins) % bins)] += share * (before(k + 0.5) - before(k - 0.5));
    return axis;
}
std::vector<double> with_copy(double sigma, double at, double share, double distance) {
    std::vector<double> axis = spot(sigma, at);
    const std::vector<double> copy = spot(sigma, at + distance, share);
    for (std::size_t k = 0; k < axis.size(); ++k) axis[k] += copy[k];
    return axis;
}

TEST(CopiedSpot, is_none_of_one_spot) {
    for (const double sigma : {0.2, 0.3, 0.5, 0.7, 0.9}) {
        for (const double at : {4.0, 4.1, 4.25, 4.5, 3.6})
            EXPECT_LT(copied_share(spot(sigma, at), at, kHalfCore), kOfBins) << sigma << " " << at;
    }
}

TEST(CopiedSpot, has_its_share_whatever_the_width_of_the_spot) {
    for (const double sigma : {0.3, 0.5, 0.7, 0.85}) {
        for (const double share : {0.03, 0.06, 0.1}) {
            for (const double distance : {2.0, -2.0, 2.5, 3.0, -3.5, 4.0, -4.0}) {
                const double of_light = share / (1 + share),
                             found = copied_share(with_copy(sigma, 4, share, distance), 4, kHalfCore);
                EXPECT_NEAR(found, of_light, kOfBins) << sigma << " " << share << " " << distance;
            }
        }
    }
}

// Two on opposite sides cancel in the cumulants of odd order.
TEST(CopiedSpot, on_both_sides_has_the_share_of_both) {
    for (const double sigma : {0.3, 0.5, 0.7}) {
        for (const double share : {0.06, 0.1, 0.2}) {
            for (const double distance : {2.0, 2.5, 3.0}) {
                std::vector<double> axis = with_copy(sigma, 4, share / 2, distance);
                const std::vector<double> other = spot(sigma, 4 - distance, share / 2);
                for (std::size_t k = 0; k < axis.size(); ++k) axis[k] += other[k];
                const double of_light = share / (1 + share), found = copied_share(axis, 4, kHalfCore);
                EXPECT_NEAR(found, of_light, 0.15 * of_light + kOfBins) << sigma << " " << share << " " << distance;
            }
        }
    }
}

TEST(CopiedSpot, is_not_looked_for_in_few_bins) {
    EXPECT_EQ(copied_share(spot(0.5, 2.2, 1, 5), 2.2, kHalfCore), 0);
    EXPECT_EQ(copied_share(std::vector<double>(kBins, 0.0), 4, kHalfCore), 0);
}

}  // namespace
}  // namespace hord::algo
