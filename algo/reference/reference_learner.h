// Learns a Reference from frames of good parts, in passes: poses, reference HORDs, both again, spread. Each pass reads
// the frames anew, the last one three times and in another order, and one is held at a time: the memory does not depend
// on the number of parts.
//
// A part is left out, with the reason, if it cannot be registered, its frame has too little light, or it is the
// only cause of the deviation in too many lenslets (kOutlierLenslets plus four times the median of all parts). If the
// sensor's electrons a DN are not given, they are estimated (algo/reference/photon_noise.h). The passes:
// docs/notes/reference.md.
#pragma once

#include <array>
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
    // The dark level is as low as the read noise allows, at most `levels.dark`: only so does the shape of a HORD not
    // depend on the exposure.
    bool dark_from_noise = false;
    std::optional<float> electrons_per_dn;  // none: estimated
    float read_dn = 0.6F;
    float pedestal_dn = 0;  // the camera adds it to every sample
    // A frame's own dark bins may lie so far above the dark level, DN; 0: the default of the bit depth. What they read
    // above it is subtracted, as an inspection does (algo/light/dark_bins.h).
    std::uint32_t max_dark_rise_dn = 0;
    int threads = 1;
    std::function<void(double)> progress = [](double) {};  // 0..1
    // What errors call a part.
    std::function<std::string(std::size_t part)> name_of = [](std::size_t part) {
        return "part " + std::to_string(part + 1);
    };
};

struct LeftOut {
    std::size_t part = 0;  // index of its frame, from 0
    std::string why;
};
struct Learned {
    Reference reference;
    std::vector<LeftOut> left_out;
    std::vector<std::optional<Pose>> poses;  // of the parts, relative to the reference; none if left out
    // No place of the field shows photon noise alone: form and ripple are counted as noise in the electrons a DN.
    bool gain_unsure = false;
    // Whether most parts' maps say where the part lies along x and y, and how it is turned.
    std::array<bool, 3> pose_determined{};
};

// Sentences for people, without a full stop: what the parts do not determine, and how far others may lie. `cure`: how
// to give the electrons a DN. `reject_score`: the recipe's.
std::vector<std::string> unsure_of(const Learned& learned, const std::string& cure, double reject_score);

// The frame of part 0..count-1, macro-pixels. Any error ends the learning.
using FrameOfPart = std::function<Result<Frame>(std::size_t part)>;

// Fails with invalid_argument if frames differ in size or depth, or fewer than Reference::kMinParts parts are left.
Result<Learned> learn_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                const LearnOptions& options);

}  // namespace hord::algo
