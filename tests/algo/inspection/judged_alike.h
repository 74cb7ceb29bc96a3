// Two inspections of one frame, with bounds of the EMD gradient and with its exact map: what must be the same.
#pragma once

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"

namespace hord::algo::testing {

inline constexpr InspectionLimits kUnlimited{1'000'000'000, 0, 0};

inline Pipeline pipeline_for(const Extents& e, int bits, const Recipe& recipe, MapSet maps, int threads = 1) {
    auto made = Pipeline::create(e, bits, recipe, threads, maps);
    EXPECT_TRUE(made) << made.error().message();
    return std::move(*made);
}

inline int pick(std::mt19937_64& random, int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
}

// Judges any frame.
inline Recipe unchecked() {
    Recipe recipe;
    recipe.part_required = recipe.check_period = false;
    recipe.max_offset_bins = recipe.max_spot_bins = recipe.max_second_share = 0;
    return recipe;
}

inline void expect_same_verdict(const Inspection& seen, const Inspection& exact) {
    ASSERT_EQ(seen.verdict, exact.verdict);
    ASSERT_EQ(seen.reason, exact.reason);
    ASSERT_EQ(seen.score, exact.score);
    ASSERT_EQ(seen.defects.size(), exact.defects.size());
    for (std::size_t d = 0; d < seen.defects.size(); ++d) {
        const Defect &a = seen.defects[d], &b = exact.defects[d];
        ASSERT_TRUE(a.m == b.m && a.n == b.n && a.area == b.area && a.peak == b.peak && a.kind == b.kind &&
                    a.length == b.length && a.width == b.width && a.score == b.score)
            << d;
    }
}

}  // namespace hord::algo::testing
