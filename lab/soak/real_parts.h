// Rendered parts for the soak, judged by the real pipeline, in place of tokens and the stand-in inspector.
#pragma once

#include "lab/soak/simulated_line.h"

namespace hord::lab {

// Gives the line a pool of frames: 24 x 24 lenslets of 9 x 9 bins, of a lens that is smaller in proportion, at the
// pitch of 111 x 111 lenslets on the full field. (Limits are per lenslet: on a coarser grid a clear lens would exceed
// them by its own curvature.) Three good parts and one of each defect, the same in every soak.
//
// Thread-safe; the first call renders the pool. Fails as rendering does.
Result<void> show_real_parts(LineOptions& line);

}  // namespace hord::lab
