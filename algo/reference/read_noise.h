// Estimates the sensor's read noise from frames of a part: the spread of the dark bins about their median.
//
// A bin is dark if it lies kFarBins or more from every bin of its lenslet that reads at least 1/16 of the lenslet's
// brightest bin. Lenslets whose brightest bin is below kBright times the dark level are left out: faint light may be
// anywhere. If the sensor clips readings at 0, only the upper half is used: the result is the standard deviation of the
// normal distribution whose rounded upper half has the measured mean square. Readings more than five standard
// deviations from the median are left out (scattered light, hot pixels).
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
