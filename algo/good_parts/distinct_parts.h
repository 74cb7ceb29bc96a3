// Which frames show the same part: copies and repeated exposures count once, because they say nothing new of how good
// parts differ.
//
//   copy      The same samples, also mirrored or turned by 90, 180 or 270 degrees (lenslets and bins together).
//   exposure  Light and mean deflections differ by noise alone: their differences are as large over areas of 3x3 and
//             9x9 lenslets, and over the whole field, as those of single lenslets say that noise is. The sensor's gain
//             need not be known. Half the light is still the same part.
//
// Two parts of the same form that lie alike by chance look like two exposures of one. So exposures are joined only if
// more pairs lie so close than pairs a little further apart make likely (docs/notes/reference.md, "Distinct parts").
// The same part, placed again in another pose, counts as another part.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/reference/reference_learner.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

class DistinctParts {
  public:
    // `dark_dn` is subtracted from every sample.
    DistinctParts(const Extents& extents, std::uint32_t dark_dn);

    // The next frame, of the extents' size. Keeps at most 32x32 areas of it, 20 kB.
    void add(const FrameView& frame);

    struct Groups {
        std::vector<std::size_t> part_of;  // of each frame, from 0, in the order of their first frames
        std::size_t parts = 0;
        // Distinct parts at least (97.5 % sure), for bounds: frames that are not joined may be repeated exposures, too.
        std::size_t at_least = 0;
        std::size_t copies = 0, exposures = 0;  // frames that are copies, repeated exposures of an earlier one
    };
    [[nodiscard]] Groups groups() const;

  private:
    struct Shown {
        std::uint64_t content = 0;               // the same for all copies
        std::vector<float> light, x, y, spread;  // one value an area; `spread`: variance of a ray's deflection, bins^2
    };
    struct Distance {
        double field = 0;  // chi-square with two degrees of freedom over the whole field
        double local = 0;  // how far the differences over smaller areas exceed noise, standard deviations
    };
    [[nodiscard]] Distance distance(const Shown& a, const Shown& b) const;
    [[nodiscard]] double white(const std::vector<double>& differences, int side) const;

    Extents extents_;
    std::uint32_t dark_dn_;
    int side_, columns_, rows_;  // of an area, lenslets; areas
    std::vector<Shown> frames_;
};

// One sentence; empty if every frame shows a part of its own.
std::string describe(const DistinctParts::Groups& groups);

// The frames to learn a reference from: the first of each part. Else copies of a bad part would support each other.
struct PartsToLearn {
    std::vector<std::size_t> frames;  // indices, ascending
    std::string repeated;             // describe(DistinctParts::Groups)
};
// Of `count` macro-pixel frames. `options` has the frames' noise and levels. Fails with invalid_argument, saying how
// many more are needed, if they show fewer than Reference::kMinParts distinct parts, and with any error of `frame_of`.
Result<PartsToLearn> parts_to_learn(const Extents& extents, std::size_t count, const FrameOfPart& frame_of,
                                    const LearnOptions& options);

}  // namespace hord::algo
