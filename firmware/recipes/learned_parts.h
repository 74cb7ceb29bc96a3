// How a reference was learned: what its report (firmware/diagnostics/learn_report.h) is made from.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algo/recipe/recipe.h"
#include "algo/reference/reference_learner.h"

namespace hord::firmware {

struct LearnedParts {
    std::filesystem::path file;  // of the reference
    std::shared_ptr<const algo::Reference> reference;
    algo::Recipe recipe;  // its limits and pitches

    // One frame of each part, learned from or left out. `left_out`, `poses` and `frame_of` count these.
    std::vector<std::string> frames;  // what they are called
    std::vector<algo::LeftOut> left_out;
    std::vector<std::optional<algo::Pose>> poses;
    algo::FrameOfPart frame_of;
    std::string repeated;             // describe(DistinctParts::Groups)
    std::vector<std::string> unsure;  // algo::unsure_of()

    algo::LearnOptions learning;                  // without `progress`
    std::string electrons_from, read_noise_from;  // "given", "estimated" or "assumed"
};

}  // namespace hord::firmware
