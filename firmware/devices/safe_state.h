// The safe state after the service ended for any reason: lights off, ejector at rest, no run permit.
#pragma once

#include "common/result.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// Turns the configured lights off and brings the configured rejector to its safe state, each also if the other fails;
// then releases both. Blocks for `patience` at most. Fails with timeout (the module does not answer) and as
// request_outputs() does.
Result<void> make_safe(const Config& config, Duration patience);

inline constexpr Duration kSafePatience = milliseconds(3000);

}  // namespace hord::firmware
