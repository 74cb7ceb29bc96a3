// Estimates the sensor's read noise from frames of a part: the spread of the dark bins about their median, where least
// light is diffracted. Which bins are dark, and what is left out: docs/notes/reference.md.
//
// Error about 10 % from 0.3 DN on. Less noise than that cannot be seen in whole DN; the result is then 0.
#pragma once

#include <cstddef>
#include <functional>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

// DN, from the first eight of `count` macro-pixel frames. Uses the dark level of `levels`. Fails with invalid_argument
// if there are too few dark bins, and with any error of `frame_of`.
Result<float> read_noise_of(const Extents& extents, const LightLevels& levels, std::size_t count,
                            const std::function<Result<Frame>(std::size_t)>& frame_of);

}  // namespace hord::algo
