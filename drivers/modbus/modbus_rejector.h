// A rejector behind the outputs of a Modbus module (TCP, or RTU on a serial line), by libmodbus.
//
// The driver's own thread writes; reports come on the loop's thread. A coil is written, then read back: that proves the
// module's register, not the valve. Where a confirm sensor sees the ejected part arrive, a command is confirmed by that
// alone. No command is ever written twice: after a lost answer it may or may not have acted, and its report says failed
// unless the coil reads back as written. Over TCP the connection is then closed and made anew, because a late answer
// would be taken for that to every later request; the first thing written on a new connection is the safe state, so
// that a command whose answer was lost does not hold the ejector. A serial line is listened to until it is silent, and
// goes on.
//
// On lost communication a module drops its outputs to 0, if it has a watchdog: the driver sets it (watchdog) and keeps
// it alive. Wire the ejector energise-to-pass where a bad part must not pass then, and the run permit so that 0 stops
// the line.
//
// Commands go before everything that can wait: reading back at rest, the watchdog and the confirm sensor are asked in
// the gaps.
#pragma once

#include <memory>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/rejector.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::drivers {

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
