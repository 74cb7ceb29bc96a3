// Learns a Reference from frames of good parts.
//
// Frames are asked for again and again, in order, and one is held at a time: any number of parts, the same memory. The
// passes:
//   1  where each part lies, compared with one of them; the middle of these poses becomes the reference's
//   2  reference HORDs: the mean of all parts' HORDs at the same place of the part (cubic interpolation between
//   lenslets) 3  poses and reference HORDs again, now registered to the reference ones, which are free of noise 4
//   spread: how much the parts differ from the reference HORDs, beyond what their light explains. Trimmed: the largest
//   of a lenslet's
//      squared deviations is left out and the mean corrected for it (as if normal), then averaged over 3x3 lenslets.
//      Where the largest ones of most of the 3x3 say more (at edges deviations are not normal: they are how an edge
//      lies between lenslets), that.
// A part is left out, with the reason, and passes 3 and 4 are made again,
//   - when it cannot be registered, or its frame has too little light;
//   - when, in more than kOutlierLenslets lenslets and four times as many as the median part, it alone makes the
//   deviation: its share of
//     the sum of squared scores is what Grubbs' test does not allow.
// Where the sensor's electrons a DN are not given they are estimated in pass 4: so that the median lenslet's chi-square
// is what noise gives.
//
// Doubles: learning judges no part.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "algo/reference/reference.h"
#include "common/frame.h"

namespace hord::algo {

constexpr int kOutlierLenslets = 4;

struct LearnOptions {
    LightLevels levels;
    std::optional<float> electrons_per_dn;  // none: estimated
    float read_dn = 0.6F;
    float pedestal_dn = 0;  // what the camera adds to every sample
    int threads = 1;
    std::function<void(double)> progress = [](double) {};  // 0..1
};

struct LeftOut {
    std::size_t part = 0;  // of the frames, from 0
    std::string why;
};
struct Learned {
    Reference reference;
    std::vector<LeftOut> left_out;
    std::vector<std::optional<Pose>> poses;  // of the parts, compared with the reference; none where left out
};

// The frame of part 0..count-1, macro-pixels. Any error ends the learning.
using FrameOfPart = std::function<Result<Frame>(std::size_t part)>;

// Fails with invalid_argument when frames are not of one size and depth, or fewer than Reference::kMinParts are left.
Result<Learned> learn_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                const LearnOptions& options);

}  // namespace hord::algo
