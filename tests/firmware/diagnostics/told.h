// What the tests of sentences about verdicts share.
#pragma once

#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "algo/reference/reference.h"
#include "firmware/diagnostics/verdict_text.h"

namespace hord::firmware {

using algo::FrameFault;
using algo::Reason;
using algo::Verdict;

constexpr algo::Extents kField{41, 31, 9, 9};

inline algo::Recipe recipe(bool with_reference, float lenslet_mm = 0) {
    algo::Recipe recipe;
    recipe.lenslet_mm = lenslet_mm;
    if (with_reference) recipe.reference = std::make_shared<algo::Reference>();
    return recipe;
}

// The same sentence with and without a reference.
inline std::string told(const algo::Inspection& found, float lenslet_mm = 0) {
    std::string sentence = explain(found, recipe(false, lenslet_mm), kField);
    EXPECT_EQ(explain(found, recipe(true, lenslet_mm), kField), sentence);
    return sentence;
}

inline algo::Inspection unfit(Reason reason, const algo::FrameFindings& frame = {}) {
    algo::Inspection found;
    found.verdict = Verdict::unfit;
    found.reason = reason;
    found.frame = frame;
    return found;
}

}  // namespace hord::firmware
