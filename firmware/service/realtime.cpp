#include "firmware/service/realtime.h"

#include <cerrno>
#include <cstring>

#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>

namespace hord::firmware {

std::vector<Error> take_realtime_policy(int priority) {
    std::vector<Error> refused;
    sched_param param{};
    param.sched_priority = priority;
    if (::sched_setscheduler(0, SCHED_FIFO, &param) != 0) {
        refused.push_back(
            {ErrorCode::refused, fmt::format("real-time priority {} was refused: {}", priority, std::strerror(errno)),
             "set LimitRTPRIO= in the unit, or run as root; times may be missed while the machine is busy"});
    }
    if (::mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0) {
        refused.push_back(
            {ErrorCode::refused, fmt::format("memory cannot be locked: {}", std::strerror(errno)),
             "set LimitMEMLOCK=infinity in the unit, or run as root; times may be missed while memory is short"});
    }
    return refused;
}

}  // namespace hord::firmware
