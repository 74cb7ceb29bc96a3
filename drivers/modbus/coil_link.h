// The connection to a Modbus module by libmodbus: TCP, or a serial line (RTU). Blocking, one thread.
//
// A lost answer closes a TCP connection: it could be read as the answer to the next request. On a serial line the bytes
// that arrive within one more time-out are discarded, then the line is used again. After a damaged answer a read is
// repeated; a coil's write is not repeated: reading back shows its effect.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"
#include "drivers/modbus/modbus_options.h"

struct _modbus;  // libmodbus's context

namespace hord::drivers {

class CoilLink {
  public:
    // Nothing is opened yet.
    CoilLink(const hal::Clock& clock, ModuleAddress address, hal::Duration response_timeout);

    // Each call takes the response time-out at most (resolving the name in `host` may take longer). On a serial line:
    // twice that if one answer is lost or damaged, four times if the module is gone. connect() fails with not_found
    // (the name or the device), timeout, disconnected, io.
    Result<void> connect();
    void close();
    [[nodiscard]] bool connected() const { return connected_; }
    // Further calls return at `by` at the latest, also if their time-out is longer.
    void give_up_at(hal::TimePoint by) { give_up_ = by; }

    // The calls below fail with refused (a Modbus exception, or the coil reads back otherwise; the connection stays),
    // timeout or disconnected (the connection is closed), io (a serial line: the answer was lost, the connection
    // stays).

    // Writes a coil and reads it back at `read_at`; over TCP both share the response time-out. Without `read_at` it
    // need not read back as written, unless the answer was lost on a serial line.
    Result<void> write(int coil, bool on, std::optional<int> read_at = {});
    Result<bool> read(int coil);
    Result<bool> read_input(int number);
    Result<void> write_register(int number, int value);  // a serial line may write it twice
    enum class RegisterKind : std::uint8_t { holding, input };
    Result<std::vector<std::uint16_t>> read_registers(RegisterKind kind, int number, int count);

    // "vendor product revision", by Read Device Identification (function 43/14). Fails with unsupported if the module
    // does not have it, with refused if a gateway or another unit answers, with unreadable if the answer is
    // damaged or none of Modbus. Closes the connection, because a late answer could follow.
    Result<std::string> identify();

    // An upper estimate of recent response times; zero before the first answer.
    [[nodiscard]] hal::Duration typical_response() const { return typical_response_; }
    // When the last successful write or command was acknowledged, before reading back. The output moved before that.
    [[nodiscard]] hal::TimePoint acknowledged() const { return acknowledged_; }
    [[nodiscard]] std::string name() const;

  private:
    struct CloseContext {
        void operator()(_modbus* context) const;
    };
    enum class Again { yes, no };
    tl::unexpected<Error> failed(const std::string& what, int error);
    void limit_wait(hal::Duration timeout);
    template <class Request>
    Result<void> exchange(const std::string& what, Again again, Request request) {
        return exchange(what, again, std::move(request), timeout_);
    }
    template <class Request>
    Result<void> exchange(const std::string& what, Again again, Request request, hal::Duration timeout);
    bool ask(int function, int number, int value, std::span<std::uint8_t> data);
    Result<bool> read_bit(const char* thing, int number, int function);
    void keep_gap() const;
    std::size_t read_bytes(std::span<std::uint8_t> bytes, hal::Duration wait) const;
    void discard(hal::Duration silence);
    [[nodiscard]] std::string which(const char* thing, int number) const;
    [[nodiscard]] std::string how_to_ask() const;  // to be appended to a cure

    const hal::Clock& clock_;
    const ModuleAddress address_;
    const hal::Duration timeout_;
    const hal::Duration gap_;  // between two frames of a serial line
    bool connected_ = false;
    std::uint16_t transaction_ = 0;
    std::string of_another_;  // why the last answer is that to another request; empty: it is not
    hal::TimePoint last_byte_{};
    hal::TimePoint give_up_ = hal::TimePoint::max();
    hal::Duration typical_response_{};
    hal::TimePoint acknowledged_{};
    std::unique_ptr<_modbus, CloseContext> context_;
};

}  // namespace hord::drivers
