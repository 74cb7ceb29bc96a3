// The station's only monotonic clock, injected everywhere.
#pragma once

#include <chrono>

namespace hord::hal {

using Duration = std::chrono::nanoseconds;

// CLOCK_MONOTONIC in the service, virtual time in simulation. Not a std clock: it has no now().
struct StationTime {
    using duration = Duration;
    using rep = Duration::rep;
    using period = Duration::period;
    using time_point = std::chrono::time_point<StationTime>;
    static constexpr bool is_steady = true;
};
using TimePoint = StationTime::time_point;

class Clock {
  public:
    virtual ~Clock() = default;
    // Any thread. Never goes backwards.
    [[nodiscard]] virtual TimePoint now() const = 0;
};

}  // namespace hord::hal
