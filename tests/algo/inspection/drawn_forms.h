// Fields that are drawn as text, and what the rim's finder makes of them; verdicts on frames.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/rim.h"
#include "algo/recipe/recipe.h"
#include "tests/support/frames.h"

namespace hord::algo::testing {

using Rows = std::vector<std::string>;

// '.' free light, 'p' deflected by a bin, '+' and '-' by 0.8 bin to either side, 'd' dark, 'h' with a third of the
// light, 'q' with 120 of 200, 'g' with 196, 'b' with 198.
struct Marked {
    Rows rows;  // 'o' outside, 'r' rim, 'j' judged
    FoundPart found;
};

inline Marked marked(const Rows& drawing, PartForm form, int margin = 1, float steepest = 0) {
    const Extents e{static_cast<int>(drawing[0].size()), static_cast<int>(drawing.size()), 9, 9};
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums;
    std::vector<std::uint8_t> mask;
    for (const std::string& row : drawing) {
        for (const char c : row) {
            const double x = c == 'p' ? 1 : c == '+' ? 0.8 : c == '-' ? -0.8 : 0;
            deflections.push_back({DeflectionQ::from_raw(static_cast<std::int64_t>(x * (1 << 24))), {}});
            const std::string_view letters = "dhqgb";
            constexpr std::array<std::uint32_t, 6> light{0, 66, 120, 196, 198, 200};
            sums.push_back(light.at(std::min(letters.find(c), letters.size())));
            mask.push_back(c == 'd' ? kDark : kValid);
        }
    }
    RimFinder finder(e, margin, form, steepest);
    finder.mark(deflections, sums, mask);
    finder.look_for_missing_pieces({deflections, sums, mask});
    Marked result{{}, finder.found()};
    for (std::size_t k = 0; k < mask.size(); ++k) {
        if (k % static_cast<std::size_t>(e.m) == 0) result.rows.emplace_back();
        result.rows.back() += (mask[k] & kOutside) != 0 ? 'o' : (mask[k] & kRim) != 0 ? 'r' : 'j';
    }
    return result;
}

inline Rows turned(const Rows& rows) {
    Rows out(rows[0].size(), std::string(rows.size(), ' '));
    for (std::size_t n = 0; n < rows.size(); ++n) {
        for (std::size_t m = 0; m < rows[n].size(); ++m) out[m][n] = rows[n][m];
    }
    return out;
}

inline Rows repeated(const std::string& row, std::size_t times) { return Rows(times, row); }

inline Rows joined(std::initializer_list<Rows> blocks) {
    Rows all;
    for (const Rows& block : blocks) all.insert(all.end(), block.begin(), block.end());
    return all;
}

inline Verdict verdict_on(const Frame& frame, const Extents& e, const Recipe& recipe) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return seen->verdict;
}

}  // namespace hord::algo::testing
