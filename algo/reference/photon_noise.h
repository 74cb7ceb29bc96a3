// Estimates the sensor's electrons a DN from frames of parts: how one sample varies from frame to frame, at lenslets
// where neither a part nor its pose changes the directions of the light. These are the lenslets around which the
// reference's deflections change least: the free light beside the part, or the middle of a plate.
//
// What brightness and a shift do to the samples of a lenslet does not count: LED, dust, ripple from lenslet to lenslet,
// fixed patterns of the sensor, tilt and waves of the part.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>

#include "algo/reference/reference.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

// `reference` has light, x, y, mask, sensor.read_dn and `pedestal_dn` of the frames. Of part 0..count-1; none: the part
// is left out. Empty if the field has no such lenslets. Fails with any error of `frame_of`.
Result<std::optional<float>> electrons_per_dn_of(
    const Reference& reference, double pedestal_dn, std::size_t count,
    const std::function<Result<std::optional<Frame>>(std::size_t part)>& frame_of);

}  // namespace hord::algo
