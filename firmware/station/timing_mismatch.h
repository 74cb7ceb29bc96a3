// A sentence with the key to change: by how much a frame or a light missed the time at which its part was exposed, or
// by how much a part came too close to the one ahead.
// The core decides on the part; this is for the person who reads the journal.
#pragma once

#include <optional>

#include "common/result.h"
#include "firmware/core/core_config.h"
#include "firmware/core/line.h"

namespace hord::firmware {

// Before the core gets the event. None: it was in time, or no part waits for it.
std::optional<Error> mismatch_of(const hal::FrameInfo& frame, const Line& line, const CoreConfig& config);
std::optional<Error> mismatch_of(const hal::PartEdge& edge, const Line& line, const CoreConfig& config);
std::optional<Error> mismatch_of(const hal::StrobeReport& report, const Line& line, const CoreConfig& config);

// After the core's step of this moment: a part whose exposure could not be requested any more.
std::optional<Error> mismatch_of(TimePoint step, const Line& line, const CoreConfig& config);

}  // namespace hord::firmware
