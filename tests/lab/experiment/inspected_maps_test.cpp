// The contrast of a known defect: a ring that dark lenslets interrupt is a ring.
#include "lab/experiment/inspected_maps.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::lab {
namespace {

// A dark disc of radius 8 in a field of 41: its edge shows on the left half alone; on the right the lenslets beside it
// have no gradient.
TEST(ContrastOfADefect, closes_a_ring_over_lenslets_without_a_value) {
    const algo::Extents e{41, 41, 9, 9};
    std::vector<float> signal(e.lenslets(), 1.0F);
    std::vector<std::uint8_t> mask(e.lenslets(), algo::kValid);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const double r = std::hypot(m - 20, n - 20);
            const auto k = static_cast<std::size_t>(n * e.m + m);
            if (m % 40 == 0 || n % 40 == 0) mask[k] = algo::kBorder;  // the field's edge is no ring
            if (r <= 8) mask[k] = algo::kDark;
            else if (r <= 10 && m > 20) mask[k] = algo::kBorder;
            else if (r <= 10) signal[k] = 9;
        }
    }
    const Contrast seen = contrast_of(signal, mask, e, {20, 20, 8, 201, "bubble"}, {1, 1, 1, 0.1}, 0);
    double ring = 0;
    for (const float v : signal) ring += v > 2 ? 1 : 0;
    EXPECT_NEAR(seen.blob_radius, std::sqrt(ring / std::numbers::pi), 1e-9);  // the half ring alone
    EXPECT_NEAR(seen.closed_radius, 10, 0.3);
    EXPECT_EQ(seen.ratio, 9);
}

}  // namespace
}  // namespace hord::lab
