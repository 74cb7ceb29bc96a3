// The maps of a part's frame, and the contrast of a known defect in them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"
#include "algo/verdict/verdict.h"
#include "common/frame.h"
#include "common/result.h"
#include "hal_sim/optics/camera/render.h"
#include "lab/optics/truth.h"

namespace hord::lab {

// The station's maps of one frame (algo/inspection/pipeline.h), copied, and its verdict.
struct InspectedMaps {
    algo::Extents extents;
    std::vector<float> emd, frobenius, transmission;
    std::vector<std::uint8_t> mask;                // algo::MaskBit
    algo::Verdict verdict = algo::Verdict::unfit;  // of the recipe
    double score = 0;
};
Result<InspectedMaps> inspect_frame(const Frame& frame, const algo::Extents& extents, int threads,
                                    const algo::Recipe& recipe = {});

// The frame with every lenslet that is dark in `maps` filled evenly, as a substitute for its missing HORD.
Frame with_dark_as_uniform(const Frame& frame, const InspectedMaps& maps);

// Statistics of a signal over the interior of a clean part: the lenslets with mask kValid.
struct Interior {
    double p50 = 0, p99 = 0, mean = 0, sigma = 0;
};
Interior interior_of(std::span<const float> signal, std::span<const std::uint8_t> mask);

// A defect in a map of signals (0: as a good part would be; larger: more conspicuous). Lenslets without a value do not
// count.
struct Contrast {
    double peak = 0;   // largest signal within three lenslets of the defect
    double ratio = 0;  // peak over the clean interior's 99th percentile, or `floor` where that is larger
    // (Mean over the defect and 1.5 lenslets around it - the clean mean) over the clean sigma, or floor / 3.
    double to_noise = 0;
    // Lenslets: radius of a disc with the area of the visible signal, holes filled. Closed: lenslets without a value
    // count as visible, so that a ring about a dark middle, which they interrupt, is a ring.
    double blob_radius = 0, closed_radius = 0;
    bool seen = false;  // ratio is at least kVisible
};
constexpr double kVisible = 2;
Contrast contrast_of(std::span<const float> signal, std::span<const std::uint8_t> mask, const algo::Extents& extents,
                     const TruthDefect& defect, const Interior& clean, double floor);

// FNV-1a, 64 bits, to check that two runs gave the same bits.
std::string hash_of(std::span<const std::byte> bytes);
std::string hash_of(std::span<const float> values);

}  // namespace hord::lab
