// A blocking Modbus TCP client over libmodbus for `hordctl` and the tests. It shares no code with the server.
//
// After an error the connection is closed, because a late reply would be taken for the next one; the next call connects
// again. A write that fails may have been executed.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/result.h"
#include "firmware/core/commands.h"
#include "firmware/registers/register_map.h"

struct _modbus;  // of libmodbus

namespace hord::firmware::modbus {

// "HOST", "HOST:PORT", "[V6]:PORT"; the port is 502 when not given. Fails with invalid_argument.
struct Endpoint {
    std::string host;
    std::uint16_t port = 502;
};
[[nodiscard]] Result<Endpoint> parse_endpoint(std::string_view text);

class Client {
  public:
    // Blocks for at most `timeout`, as does every call. Fails with disconnected (no answer at that
    // address), timeout, not_found (host name).
    [[nodiscard]] static Result<Client> connect(Endpoint endpoint, std::chrono::milliseconds timeout);

    // Holding registers, 1..125 and 1..123 at a time. Fails with refused (an exception reply; `what` names
    // it), busy (exception 06), timeout, disconnected, invalid_argument.
    [[nodiscard]] Result<std::vector<std::uint16_t>> read(std::uint16_t address, std::size_t count);
    [[nodiscard]] Result<void> write(std::uint16_t address, std::span<const std::uint16_t> values);

    // The station's chain of blocks, read from register 0 to its end. Fails as read() does, and with unreadable
    // when the chain does not begin with IDENT and its magic, or does not end.
    struct Place {
        std::uint16_t id = 0, base = 0, length = 0;
    };
    [[nodiscard]] Result<std::vector<Place>> walk();

    // One block, read in one request and decoded; the chain is walked once a connection. Fails with not_found when the
    // station does not have it.
    [[nodiscard]] Result<std::vector<Reading>> read_block(BlockId id);

    // One result of the ring, by its sequence. Fails as read() does, and with not_found when its slot holds
    // another result.
    [[nodiscard]] Result<std::vector<Reading>> read_result(std::uint32_t sequence);

    // Executes one command exactly once: repeats the write with the same token until it is known to have arrived, then
    // polls for the reply. Fails as read() and write() do, with timeout after `patience`. A refusal by the station is a
    // reply, not a failure. `who` (at most 20 printable ASCII characters) is recorded: on whose behalf.
    struct Reply {
        CommandState state = CommandState::none;
        CommandError error = CommandError::none;
        std::uint32_t result = 0;
        std::string error_name = {};              // "not_in_this_state"
        std::string remarks = {};                 // for people; empty: none, or an older station
        std::optional<State> station_state = {};  // after that refusal

        // The error's name, and the remarks if there are some.
        [[nodiscard]] std::string why() const { return remarks.empty() ? error_name : error_name + ", " + remarks; }
        // What a person can do about a refusal. Names the commands that the state allows; `offered`: of these only
        // those that the asking program sends; null: all.
        [[nodiscard]] std::string cure(bool (*offered)(Command) = nullptr) const;
    };
    [[nodiscard]] Result<Reply> command(Command code, std::uint32_t argument, std::uint32_t argument2,
                                        std::chrono::milliseconds patience, std::string_view who = {});

  private:
    struct FreeContext {
        void operator()(_modbus* context) const;
    };
    Client(Endpoint endpoint, std::chrono::milliseconds timeout) : endpoint_(std::move(endpoint)), timeout_(timeout) {}
    [[nodiscard]] std::string where() const;
    Result<void> ensure_connected();
    tl::unexpected<Error> failed(const std::string& doing);  // after a failed call

    Endpoint endpoint_;
    std::chrono::milliseconds timeout_;
    std::unique_ptr<_modbus, FreeContext> context_;  // null: not connected
    std::vector<Place> places_;                      // of this connection; empty: not walked yet
};

}  // namespace hord::firmware::modbus
