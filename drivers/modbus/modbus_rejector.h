// A rejector on the outputs of a Modbus module (TCP, or RTU on a serial line), by libmodbus.
//
// The driver's own thread writes; reports come on the loop's thread. A coil is written and then read back: this proves
// the module's register, not the valve. With a confirm sensor, only the arrival of the ejected part confirms a command.
// Commands have priority: checks, the watchdog and the confirm sensor are served between them.
//
// No command is ever written twice. After a lost answer it may or may not have acted; it is reported as failed unless
// the coil reads back as written. The first write on a new TCP connection is the safe state, which ends a pulse whose
// answer was lost.
//
// Wire the ejector energise-to-pass if a bad part must not pass without a link, and the run permit so that 0 stops the
// line.
#pragma once

#include <memory>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/rejector.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::drivers {

class ModbusRejector final : public hal::Rejector {
  public:
    // `loop` runs in real time and outlives the driver. start() opens the link.
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
