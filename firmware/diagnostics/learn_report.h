// The report of a learned reference, beside its file: what varies between the good parts, where they lay, which were
// left out and why, and what the reference will do with others. `hordctl learn` and a teach write it, the page shows
// it.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "algo/good_parts/reference_check.h"
#include "algo/good_parts/variation.h"
#include "common/result.h"
#include "firmware/recipes/learned_parts.h"

namespace hord::firmware {

struct LearnReport {
    const LearnedParts& parts;  // outlives the report
    algo::ReferenceCheck check;
    algo::Variation variation;
};

// Learns the reference again from some of the parts at a time, judges the others by it, and finds what varies. Holds
// one more reference and one frame at a time. `trials`: painted flaws of each kind. `progress`: 0 to 1. Fails as
// `parts.frame_of`.
Result<LearnReport> check_learned(
    const LearnedParts& parts, std::size_t trials = algo::CheckOptions{}.trials,
    const std::function<void(double)>& progress = [](double) {});

// The line about the reference, without a full stop.
std::string summary_of(const LearnedParts& parts);

// A sentence for people, and the part of the report that it belongs to: "parts", "left-out", "variation",
// "false-rejects" or "flaws".
struct LearnSentence {
    std::string_view about;
    std::string text;
};
std::vector<LearnSentence> describe(const LearnReport& report);

// Writes report_file() of every kind, the JSON last: where it is, the others are. Returns the files. Fails with io,
// refused; files that were written before stay.
Result<std::vector<std::filesystem::path>> write_learn_report(const LearnReport& report);

}  // namespace hord::firmware
