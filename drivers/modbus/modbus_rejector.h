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
#include <string>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/module_map.h"
#include "drivers/hal/rejector.h"
#include "drivers/modbus/coil_link.h"

namespace hord::drivers {

struct ModbusRejectorOptions {
    ModuleAddress address;          // unit: 1..247, or 255 for a TCP module that is addressed by its IP alone
    hal::ModuleMap map;             // what is particular about the module
    int ejector_coil = 0;           // 0..65535, as on the wire (a manual's coil 00001 is 0 here)
    int permit_coil = 1;            // -1: none
    bool energise_to_pass = false;  // the ejector acts while its coil is 0
    // Not zero: the module times the pulse itself, by its pulse coil, and it is so long. A command acts when that fits
    // into its window.
    hal::Duration module_pulse{};
    int confirm_input = -1;  // discrete input that becomes active when an ejected part arrives; -1: none
    bool confirm_active_low = false;
    hal::Duration confirm_within = std::chrono::milliseconds(80);  // after the window's end at the latest
    hal::Duration watchdog{};  // the module drops its outputs after so long without the driver; zero: left as it is
    hal::Duration response_timeout = std::chrono::milliseconds(30);  // 5 ms..1 s
    hal::Duration reconnect_every = std::chrono::milliseconds(100);
    hal::Duration check_every = std::chrono::milliseconds(100);  // outputs are read when nothing else is asked
    hal::Duration confirm_every = std::chrono::milliseconds(2);  // the confirm sensor, while a part is awaited
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
