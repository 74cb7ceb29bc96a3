// One value per lenslet of a feature that compares: over neighbours, or against a reference of the same place.
//
//   over neighbours      a distance: the gradient norm sqrt(x^2 + y^2) of the distances left-right and above-below
//                        (algo/features/gradient.h); or a number of the Jacobian (algo/features/jacobian.h)
//   against a reference  the distance between the HORDs of frame and reference at the same place; no border
//
// Values do not depend on the number of threads or the instruction set, to the bit. They are finite, and 0 where `mask`
// marks a missing value; its bit kAtLimit flags values that are a limit instead of a distance. They are floats of the
// doubles of algo/features/distance.h, or differ from those by at most 6e-5 (algo/soa/soa_distances.h, for the features
// and bins that it covers). Nothing is allocated after create().
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "algo/features/distance.h"
#include "algo/features/feature.h"
#include "algo/frame/decode.h"
#include "algo/frame/mask.h"
#include "common/opaque.h"

namespace hord::algo {

struct FeatureMap {
    std::span<const float> values;       // row by row, in the feature's unit (unit_of)
    std::span<const std::uint8_t> mask;  // MaskBit; kBorder also where the reference has no HORD
    std::uint64_t at_limit = 0;          // lenslets flagged kAtLimit
};

struct FeatureMapOptions {
    Distance::Options distance = {};  // ground distance: direction map, threshold
    int threads = 1;                  // including the calling one
    Isa isa = best_isa();             // same values for each, to the bit
};

// Not thread-safe.
class FeatureMapper {
  public:
    using Options = FeatureMapOptions;

    // Fails with invalid_argument if the feature does not compare (transmission), or extents, bits, threads or the
    // ground distance are invalid; with busy if no thread can be started; with unsupported if the processor lacks
    // `isa`.
    static Result<FeatureMapper> create(const Extents& extents, int bits, const LightLevels& levels, Feature feature,
                                        const Options& options = {});

    // The spans stay valid until the next call. Fails with invalid_argument if the frame's size or depth differs from
    // create()'s.
    Result<FeatureMap> over_neighbours(const FrameView& frame);

    // Also fails if the feature is not a distance. `reference`: a frame, decoded like the first one.
    Result<FeatureMap> against(const FrameView& frame, const FrameView& reference);

  private:
    struct State;
    explicit FeatureMapper(common::Opaque<State> state) : state_(std::move(state)) {}
    common::Opaque<State> state_;
};

}  // namespace hord::algo
