// The connection to a Modbus module, TCP or a serial line (RTU), over libmodbus. Blocking, one thread.
//
// What a lost or damaged answer means differs. Over TCP a late answer would be taken for that of every later request:
// after any time-out the connection is closed. A serial line has no connection, but a late answer ends, too: what still
// comes within one more time-out is thrown away, and the line is good again. A request whose answer was damaged is
// known by reading back, and only what may be repeated is: a coil is never written twice.
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

    // Each waits for `timeout` at most, all its parts together (a name in `host` may take the resolver longer). On a
    // serial line: twice that where one answer is lost or damaged, until the line is good again; four times where the
    // module is gone. Fails with not_found (the name or the device), timeout, disconnected, io.
    Result<void> connect(hal::Duration timeout);
    void close();
    [[nodiscard]] bool connected() const { return connected_; }
    // From now on nothing takes longer than until `by`, whatever its time-out.
    void give_up_at(hal::TimePoint by) { give_up_ = by; }

    // Fail with refused (an exception, or it reads back otherwise; the connection stays), timeout or disconnected (the
    // connection is closed, but for a serial line that answers again), io (a serial line: the write did not arrive).

    // Writes a coil and reads it back at `read_at`.
    Result<void> write(int coil, bool on, int read_at, hal::Duration timeout);
    // Writes a coil that need not read back as written; on a serial line, where the answer is lost, it counts when it
    // does.
    Result<void> command(int coil, bool on, hal::Duration timeout);
    Result<bool> read(int coil, hal::Duration timeout);
    Result<bool> read_input(int number, hal::Duration timeout);
    // A register's write may be repeated: writing it twice must be harmless.
    Result<void> write_register(int number, int value, hal::Duration timeout);
    Result<std::vector<std::uint16_t>> read_input_registers(int number, int count, hal::Duration timeout);
    Result<std::uint16_t> read_register(int number, hal::Duration timeout);

    // "vendor product revision", by Read Device Identification (function 43/14); fails with unsupported where the
    // module has none. Leaves the connection closed: what a module that does not know it may still say belongs to
    // nobody.
    Result<std::string> identify(hal::Duration timeout);

    // How long an answer takes lately, rather too long; zero before the first.
    [[nodiscard]] hal::Duration usual() const { return usual_; }
    // When the last write or command that succeeded was acknowledged, before it was read back: until then the output
    // had moved.
    [[nodiscard]] hal::TimePoint acknowledged() const { return acknowledged_; }
    [[nodiscard]] std::string name() const;

  private:
    struct Context;
    enum class Again { yes, no };
    tl::unexpected<Error> failed(const std::string& what, int error);
    void wait_at_most(hal::Duration timeout);
    template <class Request>
    Result<void> exchange(const std::string& what, hal::Duration timeout, Again again, Request request);
    Result<void> write_and_look(const std::string& what, int coil, bool on, int read_at, hal::Duration timeout,
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
    hal::Duration usual_{};
    hal::TimePoint acknowledged_{};
    std::unique_ptr<Context> context_;
};

}  // namespace hord::drivers
