// One value a lenslet, of any feature that compares: over neighbours, or against a reference of the same place.
//
//   over neighbours     a distance: the gradient norm sqrt(x^2 + y^2) of the distances left-right and above-below
//   (algo/features/gradient.h, with
//                       the distance chosen); a norm of the Jacobian, or its anisotropy (algo/features/jacobian.h)
//   against a reference the distance between the frame's HORD and the reference's at the same place; no border
//
// Rows are streamed through three rows of HORDs a thread; nothing is allocated after create(). Values do not depend on
// the number of threads nor on the instruction set, to the bit. They are never NaN, never infinite, 0 where `mask` says
// there is no value; its bit kAtLimit flags values that are a limit instead of a distance. emd, emd-l1, emd-sq, sliced
// and bhattacharyya are floats of the doubles that algo/features/distance.h defines, and so is every distance on a
// direction map; the others, 6e-5 at most from those, are made sixteen lenslets at a time (algo/soa/soa_distances.h).
// Transmission compares a lenslet with the whole part: that is the Pipeline's.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "algo/features/distance.h"
#include "algo/features/feature.h"
#include "algo/frame/decode.h"
#include "algo/frame/mask.h"

namespace hord::algo {

struct FeatureMap {
    std::span<const float> values;       // row by row, in the feature's unit (unit_of)
    std::span<const std::uint8_t> mask;  // MaskBit; kBorder also where the reference has no HORD
    std::uint64_t at_limit = 0;          // lenslets flagged kAtLimit
};

// Not thread-safe.
class FeatureMapper {
  public:
    struct Options {
        Distance::Options distance = {};  // ground distance: direction map, threshold
        int threads = 1;                  // the calling one included
        Isa isa = best_isa();             // the widest instruction set to use; the values are the same to the last bit
    };

    // Fails with invalid_argument when the feature compares nothing (transmission), or the extents, bits, number of
    // threads or the ground distance are impossible; with busy when the system gives no thread.
    static Result<FeatureMapper> create(const Extents& extents, int bits, const LightLevels& levels, Feature feature,
                                        const Options& options);
    static Result<FeatureMapper> create(const Extents& extents, int bits, const LightLevels& levels, Feature feature) {
        return create(extents, bits, levels, feature, Options{});
    }

    // The spans in the answer stay valid until the next call. Both fail with invalid_argument when a frame's size or
    // depth is not what create() was told.
    Result<FeatureMap> over_neighbours(const FrameView& frame);

    // Also fails when the feature is not a distance. A reference as a frame is decoded like the frame itself; as HORDs
    // (say, means over many good parts) it is one a lenslet, row by row, sum 0 where there is none.
    Result<FeatureMap> against(const FrameView& frame, const FrameView& reference);
    Result<FeatureMap> against(const FrameView& frame, std::span<const Hord> reference);

    FeatureMapper(FeatureMapper&&) noexcept;
    FeatureMapper& operator=(FeatureMapper&&) noexcept;
    ~FeatureMapper();

  private:
    struct State;
    explicit FeatureMapper(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
