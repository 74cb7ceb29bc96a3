// One Modbus TCP connection to a module's coils, over libmodbus. Blocking, one thread.
#pragma once

#include <memory>
#include <string>

#include "algo/result.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

class CoilLink {
  public:
    // Nothing is opened yet.
    CoilLink(const hal::Clock& clock, std::string host, int port, int unit);
    ~CoilLink();
    CoilLink(const CoilLink&) = delete;
    CoilLink& operator=(const CoilLink&) = delete;

    // Each waits for `timeout` at most, all its parts together (a name in `host` may take the resolver longer).
    // Fails with not_found (the name), timeout, disconnected, io.
    Result<void> connect(hal::Duration timeout);
    void close();
    [[nodiscard]] bool connected() const { return connected_; }

    // Writes a coil and reads it back. Fails with refused (an exception, or it reads back otherwise; the connection
    // stays), timeout or disconnected (the connection is closed).
    Result<void> write(int coil, bool on, hal::Duration timeout);
    Result<bool> read(int coil, hal::Duration timeout);

    [[nodiscard]] std::string name() const { return host_ + ":" + std::to_string(port_); }

  private:
    struct Context;
    tl::unexpected<Error> failed(const char* what, int coil, int error);
    void wait_at_most(hal::Duration timeout);

    const hal::Clock& clock_;
    std::string host_;
    int port_;
    int unit_;
    bool connected_ = false;
    std::unique_ptr<Context> context_;
};

}  // namespace hord::drivers
