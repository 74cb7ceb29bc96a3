// The Modbus RTU server: one serial line on the event loop, never blocking. Half duplex: bytes received during a reply
// are discarded. A lost line (an adapter was pulled) is opened again every second.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/result.h"
#include "drivers/hal/event_loop.h"
#include "firmware/modbus/dispatcher.h"

namespace hord::firmware::modbus {

struct SerialOptions {
    enum class Parity : std::uint8_t { none, even, odd };
    std::string device = "/dev/ttyS0";
    int baud = 19200;              // 1200 to 921600
    Parity parity = Parity::even;  // none: with two stop bits, as the specification requires
    std::uint8_t unit = 1;         // 1 to 247
    bool rs485 = true;  // the kernel switches the transmitter (TIOCSRS485); false: RS-232 or the adapter does
    hal::Duration gap = std::chrono::milliseconds(20);  // a longer silence ends a frame
    bool may_write = true;
    bool operator==(const SerialOptions&) const = default;
};

class RtuServer {
  public:
    // Loop thread. Fails with not_found or refused (the device), busy (another program has it), unsupported
    // (the baud rate, or a driver without RS-485), invalid_argument (the unit), io.
    [[nodiscard]] static Result<std::unique_ptr<RtuServer>> open(hal::EventLoop& loop, RegisterModel& model,
                                                                 SerialOptions options);
    ~RtuServer();
    RtuServer(const RtuServer&) = delete;
    RtuServer& operator=(const RtuServer&) = delete;

  private:
    struct Impl;
    explicit RtuServer(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace hord::firmware::modbus
