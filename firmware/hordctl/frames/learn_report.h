// What `hordctl learn` writes beside the reference: what varies between the good parts, where they lay, and what the
// reference will do with others.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "algo/good_parts/distinct_parts.h"
#include "algo/good_parts/reference_check.h"
#include "algo/good_parts/variation.h"
#include "algo/reference/reference_learner.h"

namespace hord::firmware {

struct LearnReport {
    const std::vector<std::string>& frames;  // of the parts that were learned from or left out
    const algo::Learned& learned;
    const algo::Recipe& recipe;  // its limits and pitches
    std::string summary;         // the line about the reference
    std::string distinct;        // describe(DistinctParts::Groups)
    algo::ReferenceCheck check;
    algo::Variation variation;
};

// Sentences for people; without the table of poses.
std::vector<std::string> describe(const LearnReport& report);

// REFERENCE without its extension plus .learn.md, .learn.csv (a part a line) and .learn.png (mean, spread and modes).
// Returns the files. Fails with io.
Result<std::vector<std::filesystem::path>> write_learn_report(const LearnReport& report,
                                                              const std::filesystem::path& reference);

}  // namespace hord::firmware
