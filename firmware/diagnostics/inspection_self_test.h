// Self-test: this build on this processor distinguishes a good part from a bad one.
#pragma once

#include "common/result.h"

namespace hord::firmware {

// Inspects two synthetic parts of 15 x 15 lenslets, one smooth and one that scatters light in its middle, with the
// default recipe. Takes a few milliseconds. Fails with internal (a wrong verdict; names it), invalid_argument (bins out
// of range).
Result<void> check_judgement(int bins_i, int bins_j, int bits);

}  // namespace hord::firmware
