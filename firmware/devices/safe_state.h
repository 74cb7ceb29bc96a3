// What is done after a service that died, whatever ended it: the lights off, the ejector at rest, no run permit.
#pragma once

#include "common/result.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// Turns the configured lights off, brings the configured rejector to its safe state and lets go of both; one that fails
// does not keep the other from it. Blocks for at most `patience`. Fails with timeout (the module does not answer), and
// as taking the lights' lines does.
Result<void> make_safe(const Config& config, Duration patience);

inline constexpr Duration kSafePatience = milliseconds(3000);

}  // namespace hord::firmware
