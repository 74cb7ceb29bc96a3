// Quality of a frame of the empty, lit field: exposure, saturation, and focus of the lenslets' spots.
#pragma once

#include <string>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"
#include "common/frame.h"

namespace hord::firmware {

struct FrameQuality {
    double mean = 0;       // of all samples above the recipe's dark level, share of the full scale; all other values:
                           // above the frame's own dark level (algo/light/dark_bins.h)
    double bright = 0;     // the brightest sample of the typical lenslet (median), share of the full scale
    double saturated = 0;  // share of the lenslets with a saturated sample
    double lit = 0;        // share of the lenslets with light enough to be judged
    // The spot that parallel light makes in a lenslet: its RMS radius along one axis, bins, of the typical lit lenslet,
    // and what it would be if the light filled all bins evenly. NaN where no lenslet is lit.
    double spot_bins = 0, unfocused_bins = 0;
};

// `frame` is a macro-pixel frame of these extents. Fails with invalid_argument where it is not.
Result<FrameQuality> quality_of(const FrameView& frame, const algo::Extents& extents, const algo::Recipe& recipe);

// Result of one check: good, or the problem and its cure.
struct Judgement {
    bool good = true;
    std::string found, cure;
};
// The brightest sample between a fifth and 98 % of the full scale, and light in more than half of the lenslets.
Judgement judge_exposure(const FrameQuality& quality);
Judgement judge_saturation(const FrameQuality& quality, const algo::Recipe& recipe);
// Focused: the spot is at most half as wide as evenly filled bins are.
Judgement judge_focus(const FrameQuality& quality);
// A frame without the flash: at most a twentieth of the lit one's light.
Judgement judge_dark(const FrameQuality& without_light, const FrameQuality& lit);

}  // namespace hord::firmware
