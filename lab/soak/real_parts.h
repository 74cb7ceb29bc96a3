// Parts with optics for the soak: a pool rendered once, and the real pipeline that judges it, in place of tokens and
// stand-in.
#pragma once

#include "lab/soak/simulated_line.h"

namespace hord::lab {

// 24 x 24 lenslets of 9 x 9 bins, sampled as finely as 111 x 111 on the full field, of a lens that is smaller in
// proportion: limits are a lenslet, so on a coarser grid a clear lens would exceed them by its own curvature (its
// slope's limit by a quarter, on the full field). Three good parts and one of each defect, drawn from a seed of its
// own: every soak has the same.
//
// Any thread; the first call renders. Fails as rendering does.
Result<void> show_real_parts(LineOptions& line);

}  // namespace hord::lab
