// Over how many lenslets the light changes at a part's edges: a part that moved, or was exposed twice, is told by them.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{61, 61, 9, 9};

// The mean of exposures of a part that lies so many lenslets to the right.
template <class Part>
Frame exposed_at(const std::vector<int>& places, Part&& part) {
    std::vector<Frame> all;
    for (const int place : places)
        all.push_back(drawn(kField, 8, 220, [&](int m, int n) { return part(m - place, n); }));
    Frame mean = all.front();
    for (int y = 0; y < mean.height_px(); ++y) {
        for (int x = 0; x < mean.width_px(); ++x) {
            std::uint32_t sum = 0;
            for (const Frame& one : all) sum += one.view().sample(x, y);
            mean.set(x, y, sum / static_cast<std::uint32_t>(all.size()));
        }
    }
    return noisy(mean, {10, 2, 1}, 5);
}

FrameFault fault_of(const Frame& frame) {
    auto pipeline = Pipeline::create(kField, 8, Recipe{});
    EXPECT_TRUE(pipeline);
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return seen->frame.fault;
}

// Its edges take no light: the mixed light there is deflected, from none to the most.
TEST(EdgeWidth, of_a_weak_lens_tells_that_it_moved_or_was_exposed_twice) {
    const std::vector<int> at_rest = {0}, three = {-1, 0, 1}, five = {-2, -1, 0, 1, 2},
                           seven = {-3, -2, -1, 0, 1, 2, 3}, twice = {-3, 4};
    for (const double rim_bins : {1.2, 1.6, 2.0}) {
        const auto part = lens(kField, 19.4, rim_bins);
        for (const auto& places : {at_rest, three, five, seven, twice}) {
            const Frame frame = exposed_at(places, part);
            for (const Frame& seen : {frame, transposed(frame)}) {
                const FrameFault found = fault_of(seen);
                if (places.size() == 1 || places.size() == 3) EXPECT_EQ(found, FrameFault::none);
                else EXPECT_TRUE(found == FrameFault::blurred_edge || found == FrameFault::no_outline);
                if (HasFailure()) FAIL() << rim_bins << " bins, " << places.size() << " exposures";
            }
        }
    }
}

// A disc with a dark rim that bends light in rings: the slope beside the rim is the part's own, and goes on inside.
TEST(EdgeWidth, of_a_part_that_bends_light_by_its_own_slope_is_none) {
    for (const double ring : {12.0, 20.0, 24.0, 28.0}) {  // lenslets
        const auto rings = [&](int m, int n) -> Spot {
            const double x = m - 30, y = n - 30, r = std::hypot(x, y), into = 22 - r;
            if (into < 0 || r == 0) return {};
            const double bend = 0.05 * ring * std::sin(6.2832 * into / ring);
            return {bend * x / r, bend * y / r, into < 1 ? 0.0 : 0.92};
        };
        EXPECT_EQ(fault_of(exposed_at({0}, rings)), FrameFault::none) << ring;
    }
}

}  // namespace
}  // namespace hord::algo
