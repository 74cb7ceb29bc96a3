// The frames of good parts as a reference learns from them: without what the dark level removes, decoded lenslet by
// lenslet. The first step of algo/reference/reference_learner.h, which is its only user.
#pragma once

#include <cstddef>

#include "algo/frame/decode.h"
#include "algo/light/dark_bins.h"
#include "algo/reference/reference_learner.h"
#include "algo/reference/reference_mean.h"

namespace hord::algo {

class LearningFrames {
  public:
    // `frame_of` and `options` must outlive this.
    LearningFrames(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                   const LearnOptions& options)
        : extents_(extents), count_(count), frame_of_(frame_of), options_(options), row_(extents),
          dark_bins_(extents, bits) {}

    // Writes the dark level and what it removes from every lit bin. Fails as frame_of and check_frame().
    Result<void> choose_dark_level(Reference& reference);

    // The frame of part `of`, with what its dark bins read above the reference's dark level subtracted.
    Result<Frame> lowered(std::size_t of, const Reference& reference);

    // The same, decoded too, by the levels of the reference.
    Result<Frame> decode(std::size_t of, const Reference& reference, DecodedPart& part, bool with_shares);

  private:
    void lower(Frame& frame, const Reference& reference);

    Extents extents_;
    std::size_t count_;
    const FrameOfPart& frame_of_;
    const LearnOptions& options_;
    HordRow row_;
    DarkBinMeter dark_bins_;
};

}  // namespace hord::algo
