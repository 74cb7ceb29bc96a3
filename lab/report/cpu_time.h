// Processor time, which other programs disturb less than wall time.
#pragma once

#include <chrono>
#include <ctime>

namespace hord::lab {

inline std::chrono::nanoseconds cpu_time(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
}
inline std::chrono::nanoseconds process_cpu_time() { return cpu_time(CLOCK_PROCESS_CPUTIME_ID); }
inline std::chrono::nanoseconds thread_cpu_time() { return cpu_time(CLOCK_THREAD_CPUTIME_ID); }

// Of all threads of this process, ms.
inline double process_cpu_ms() { return std::chrono::duration<double, std::milli>(process_cpu_time()).count(); }

}  // namespace hord::lab
