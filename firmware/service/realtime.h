// The scheduling policy of a thread that has times to meet.
#pragma once

#include <vector>

#include "common/result.h"

namespace hord::firmware {

// SCHED_FIFO with this priority (1 to 99) for the calling thread, and memory locked for the process. Threads that it
// starts from now on inherit the policy, as the rejector's should; those that inspect leave it again. Returns what was
// refused, with its cure.
std::vector<Error> take_realtime_policy(int priority);

}  // namespace hord::firmware
