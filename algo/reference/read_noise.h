// The sensor's read noise, from frames of a part: what the bins read that no light reaches.
//
// Those are the bins that lie kFarBins and more from every bin of their lenslet that has a sixteenth of its brightest
// one's reading or more; lenslets whose brightest bin is below kBright times the dark level have none, for what lights
// them faintly may be anywhere. Their readings spread about their median. Where most are 0 the sensor cut off what was
// below, and the upper half tells: the standard deviation s of the normal number whose rounded upper half has the mean
// square that is seen. Readings further than five standard deviations from the median do not count: scattered light,
// hot pixels.
//
// Good to about a tenth from 0.3 DN on; noise of less than that does not show in whole DN, and is given as 0. Doubles:
// this judges no part.
#pragma once

#include <cstddef>
#include <functional>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

// DN, from the first eight of `count` macro-pixel frames. `levels`: the dark level is used. Fails with invalid_argument
// where too few such bins are seen; an error of `frame_of` ends it.
Result<float> read_noise_of(const Extents& extents, const LightLevels& levels, std::size_t count,
                            const std::function<Result<Frame>(std::size_t)>& frame_of);

}  // namespace hord::algo
