// An inspector without a pipeline, for tests of the control with millions of parts.
#pragma once

#include <functional>
#include <memory>

#include "firmware/station/inspector.h"

namespace hord::lab {

// No pipeline: `judge` returns the answer and its delay. At most `queue` parts at a time.
struct StandInAnswer {
    firmware::Judged judged;  // `part` is filled in
    hal::Duration after{};
};
using StandIn = std::function<StandInAnswer(std::uint32_t part, const hal::FrameLease& frame)>;
std::unique_ptr<firmware::Inspector> make_stand_in_inspector(hal::EventLoop& loop, int queue, StandIn judge);

}  // namespace hord::lab
