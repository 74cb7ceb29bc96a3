// Real-time scheduling.
#pragma once

#include <vector>

#include "common/result.h"

namespace hord::firmware {

// Sets SCHED_FIFO with this priority (1 to 99) for the calling thread, and locks the process's memory. Threads started
// later inherit the policy (the rejector's should); inspecting threads return to SCHED_OTHER. Returns an error for each
// refused step.
std::vector<Error> take_realtime_policy(int priority);

}  // namespace hord::firmware
