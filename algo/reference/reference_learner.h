// Learns a Reference from frames of good parts.
//
// The frames are read once in each pass, in order, and one is held at a time: the memory does not depend on the number
// of parts. The passes:
//   1  poses of the parts, relative to one of them; the median pose becomes that of the reference
//   2  reference HORDs: the mean of the HORDs of all parts at the same place of the part (cubic interpolation)
//   3  poses and reference HORDs again, now registered to the mean HORDs of pass 2
//   4  spread: how much the parts differ from the reference HORDs beyond noise (algo/reference/spread_estimate.h)
// A part is left out, with the reason, and passes 3 and 4 are repeated, if
//   - it cannot be registered, or its frame has too little light;
//   - it alone makes the deviation (Grubbs' test on its share of the sum of squared scores) in more lenslets than
//     kOutlierLenslets plus four times the median of all parts.
// If the sensor's electrons a DN are not given, pass 4 estimates them: the median lenslet's chi-square becomes that of
// noise.
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
    float pedestal_dn = 0;  // the camera adds it to every sample
    int threads = 1;
    std::function<void(double)> progress = [](double) {};  // 0..1
};

struct LeftOut {
    std::size_t part = 0;  // index of its frame, from 0
    std::string why;
};
struct Learned {
    Reference reference;
    std::vector<LeftOut> left_out;
    std::vector<std::optional<Pose>> poses;  // of the parts, relative to the reference; none if left out
};

// The frame of part 0..count-1, macro-pixels. Any error ends the learning.
using FrameOfPart = std::function<Result<Frame>(std::size_t part)>;

// Fails with invalid_argument if frames differ in size or depth, or fewer than Reference::kMinParts parts are left.
Result<Learned> learn_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                const LearnOptions& options);

}  // namespace hord::algo
