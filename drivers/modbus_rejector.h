// A rejector behind the coils of a Modbus TCP module, by libmodbus.
//
// The driver's own thread writes; reports come on the loop's thread. A coil is written, then read back: that proves
// the module's register, not the valve. After any time-out the connection is closed and made anew, because a late reply
// would be taken for the answer to every later request; the first thing written on a new connection is the safe
// state, so that a command whose answer was lost does not hold the ejector. No command is ever written twice: after a
// time-out it may or may not have acted, and its report says failed.
//
// On lost communication a module drops its outputs to 0. Wire the ejector energise-to-pass where a bad part must not
// pass then, and the run permit so that 0 stops the line.
#pragma once

#include <memory>
#include <string>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/rejector.h"

namespace hord::drivers {

struct ModbusRejectorOptions {
    std::string host = "127.0.0.1";
    int port = 502;
    int unit = 255;                // 1..247, or 255 for a module that is addressed by its IP alone
    int ejector_coil = 0;          // 0..65535, as on the wire (a manual's coil 00001 is 0 here)
    int permit_coil = 1;           // -1: none
    bool energise_to_pass = false;  // the ejector acts while its coil is 0
    hal::Duration response_timeout = std::chrono::milliseconds(30);  // 5 ms..1 s
    hal::Duration reconnect_every = std::chrono::milliseconds(100);
    hal::Duration check_every = std::chrono::milliseconds(100);  // the ejector coil is read when nothing else is asked
};

class ModbusRejector final : public hal::Rejector {
  public:
    // `loop` runs in real time, and outlives the driver. Opens nothing: start() does.
    ModbusRejector(hal::EventLoop& loop, ModbusRejectorOptions options);
    ~ModbusRejector() override;

  private:
    Result<void> do_start(Listener& listener) override;
    Result<void> do_reject(const hal::RejectCommand& command) override;
    void do_set_run_permit(bool permit) override;
    void do_stop() override;

    struct Session;  // one start() to its stop()
    hal::EventLoop& loop_;
    ModbusRejectorOptions options_;
    std::shared_ptr<Session> session_;
};

}  // namespace hord::drivers
