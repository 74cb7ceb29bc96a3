// A ghost that a part of the field shows, or that lies on both sides of the spot, makes a frame unfit.
#include <functional>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{45, 45, 9, 9};
using Region = std::function<bool(int m, int n)>;

// A lens. In the region this share of the light lies in copies so many bins to the right, or half of it on each side.
FrameFault fault_of_ghost(double share, int bins, bool both_sides, const Region& shows) {
    const Frame clean = drawn(kField, 8, 200, lens(kField, 15, 1.5));
    Frame frame = clean;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = bins; x < frame.width_px() - bins; ++x) {
            if (!shows(x / kField.i, y / kField.j)) continue;
            const auto at = [&](int from) { return static_cast<double>(clean.view().sample(x + from, y)); };
            const double copy = both_sides ? (at(-bins) + at(bins)) / 2 : at(-bins);
            frame.set(x, y, static_cast<std::uint32_t>((1 - share) * at(0) + share * copy + 0.5));
        }
    }
    auto pipeline = Pipeline::create(kField, 8, Recipe{});
    EXPECT_TRUE(pipeline);
    const auto seen = pipeline->inspect(noisy(frame, {10, 2, 1}, 3).view());
    EXPECT_TRUE(seen);
    return seen->frame.fault;
}

bool everywhere(int, int) { return true; }

TEST(SecondSpots, on_both_sides_make_a_frame_unfit) {
    EXPECT_EQ(fault_of_ghost(0, 2, true, everywhere), FrameFault::none);
    for (const double share : {0.08, 0.1, 0.2}) {
        for (const int bins : {2, 3})
            EXPECT_EQ(fault_of_ghost(share, bins, true, everywhere), FrameFault::second_spot) << share << " " << bins;
    }
}

TEST(SecondSpots, in_a_part_of_the_field_make_a_frame_unfit) {
    const Region left = [](int m, int) { return m < kField.m / 2; };
    const Region corner = [](int m, int n) { return m > kField.m / 2 && n < kField.n / 2; };
    const Region diagonal = [](int m, int n) { return m < n; };
    for (const Region& region : {left, corner, diagonal}) {
        for (const double share : {0.08, 0.14, 0.2}) {
            for (const int bins : {2, 3})
                EXPECT_NE(fault_of_ghost(share, bins, false, region), FrameFault::none) << share << " " << bins;
        }
    }
}

}  // namespace
}  // namespace hord::algo
