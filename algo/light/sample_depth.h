// What the samples of a dim frame say of their bit depth: a camera may send fewer bits than it was said to.
#pragma once

#include <cstddef>

#include "common/frame.h"

namespace hord::algo {

// The bit depth of a usual sensor (8, 10, 12 or 14) that holds all samples, if it is below the frame's, and the light
// of most lenslets fills it: half as many samples as lenslets or more lie in its upper half. Else 0. Less light may
// look alike, so that this is a hint, and no reason to refuse a frame.
int fewer_bits(const FrameView& frame, std::size_t lenslets);

}  // namespace hord::algo
