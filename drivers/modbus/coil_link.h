// The connection to a Modbus module by libmodbus: TCP, or a serial line (RTU). Blocking, one thread.
//
// Lost answers: over TCP a late answer would be read as the answer to the next request, so a time-out closes the
// connection. On a serial line everything that arrives within one more time-out is discarded, and the line is used
// again. After a damaged answer a read is repeated; a coil's write is not, its effect is found by reading back.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::drivers {

class CoilLink {
  public:
    // Nothing is opened yet.
    CoilLink(const hal::Clock& clock, ModuleAddress address);
    ~CoilLink();
    CoilLink(const CoilLink&) = delete;
    CoilLink& operator=(const CoilLink&) = delete;

    // Each call takes `timeout` at most (resolving the name in `host` may take longer). On a serial line: twice that if
    // one answer is lost or damaged, four times if the module is gone. connect() fails with not_found (the name or the
    // device), timeout, disconnected, io.
    Result<void> connect(hal::Duration timeout);
    void close();
    [[nodiscard]] bool connected() const { return connected_; }
    // All further calls return at `by`, whatever their time-out.
    void give_up_at(hal::TimePoint by) { give_up_ = by; }

    // The calls below fail with refused (a Modbus exception, or the coil reads back otherwise; the connection stays),
    // timeout or disconnected (the connection is closed), io (a serial line: the answer was lost, the connection
    // stays).

    // Writes a coil and reads it back at `read_at`.
    Result<void> write(int coil, bool on, int read_at, hal::Duration timeout);
    // Writes a coil that need not read back as written. On a serial line, if the answer was lost, it must.
    Result<void> command(int coil, bool on, hal::Duration timeout);
    Result<bool> read(int coil, hal::Duration timeout);
    Result<bool> read_input(int number, hal::Duration timeout);
    // A serial line may write the register twice.
    Result<void> write_register(int number, int value, hal::Duration timeout);
    Result<std::vector<std::uint16_t>> read_input_registers(int number, int count, hal::Duration timeout);
    Result<std::uint16_t> read_register(int number, hal::Duration timeout);

    // "vendor product revision", by Read Device Identification (function 43/14). Fails with unsupported if the module
    // does not have it. Closes the connection, because a late answer could follow.
    Result<std::string> identify(hal::Duration timeout);

    // An upper estimate of recent response times; zero before the first answer.
    [[nodiscard]] hal::Duration typical_response() const { return typical_response_; }
    // When the last successful write or command was acknowledged, before reading back. The output moved before that.
    [[nodiscard]] hal::TimePoint acknowledged() const { return acknowledged_; }
    [[nodiscard]] std::string name() const;

  private:
    struct Context;
    enum class Again { yes, no };
    tl::unexpected<Error> failed(const std::string& what, int error);
    void wait_at_most(hal::Duration timeout);
    template <class Request>
    Result<void> exchange(const std::string& what, hal::Duration timeout, Again again, Request request);
    Result<void> write_coil(const std::string& what, int coil, bool on, int read_at, hal::Duration timeout,
                            bool must_read_back);
    void keep_gap() const;
    void discard(hal::Duration silence, hal::Duration longest);
    [[nodiscard]] std::string which(const char* thing, int number) const;

    const hal::Clock& clock_;
    const ModuleAddress address_;
    const hal::Duration gap_;  // between two frames of a serial line
    bool connected_ = false;
    hal::TimePoint last_byte_{};
    hal::TimePoint give_up_ = hal::TimePoint::max();
    hal::Duration typical_response_{};
    hal::TimePoint acknowledged_{};
    std::unique_ptr<Context> context_;
};

}  // namespace hord::drivers
