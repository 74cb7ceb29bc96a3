// The ejector that removes bad parts from the line, and the permit that lets the line run.
#pragma once

#include <cstdint>

#include "drivers/hal/clock.h"
#include "drivers/hal/device.h"

namespace hord::hal {

struct RejectCommand {
    std::uint32_t part = 0;  // a repeated command for the same part does not eject twice
    TimePoint start;         // of the ejector's pulse
    Duration width{};
};

struct RejectReport {
    enum class Outcome : std::uint8_t {
        confirmed,  // the module acknowledged the write and reads back as written (and the confirm sensor agreed, if
                    // there is one)
        late,       // too late to act on this part: the window was over, or the acknowledgement came after it
        failed,     // no acknowledgement; it may or may not have acted
    };
    std::uint32_t part = 0;
    Outcome outcome = Outcome::failed;
    TimePoint at;  // when the write was acknowledged, at the latest when the output moved; or when it was given up
};

class RejectorListener {
  public:
    virtual void on_reject(const RejectReport& report) = 0;  // exactly one for every accepted reject()
    virtual void on_rejector_link(bool up, const Error& why_down) = 0;
    // Before the report of a command that failed although the link is up: why.
    virtual void on_reject_failed(const Error&) {}

  protected:
    ~RejectorListener() = default;
};

// start() does not block. The link is down until on_rejector_link(true); the driver tries to reach the module until
// stop(). It fails with invalid_argument only (a bad address).
// stop() sets the outputs to their safe state (permit down, ejector as configured) before the link closes. Commands not
// yet settled are reported as failed before it returns. It may block for at most one response time-out.
class Rejector : public Device<RejectorListener> {
  public:
    // Loop thread, does not block. The ejector acts within [start, start + width) or not at all: later it would hit a
    // neighbour. With the link down a command is accepted and reported as failed. Fails with disconnected (not
    // started), busy (its queue is full), invalid_argument (width <= 0).
    Result<void> reject(const RejectCommand& command);

    // Loop thread, does not block. The permit drops when the link goes down. Idempotent.
    void set_run_permit(bool permit);

  protected:
    Rejector() : Device("the rejector") {}

  private:
    virtual Result<void> do_reject(const RejectCommand& command) = 0;
    virtual void do_set_run_permit(bool permit) = 0;
};

}  // namespace hord::hal
