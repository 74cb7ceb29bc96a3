// The Modbus TCP server: on the event loop, never blocking, with bounded memory.
//
// A client cannot block others. Slow or partial requests wait in the connection's own framer. A client that does not
// read its replies is not read. The first wrong header closes the connection. A turn serves a few requests of each.
//
// A new connection gets a slot. Closed for it is, in this order: one that never wrote before one that did; one of an
// address that holds more than a quarter of all slots; one that never completed a request, then one that completed few,
// then the one idle for longest. A connection that may write is never closed for one that may only read: the newcomer
// is refused then.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/event_loop.h"
#include "firmware/modbus/access.h"
#include "firmware/modbus/dispatcher.h"

namespace hord::firmware::modbus {

struct ServerOptions {
    // An address of this machine, IPv4 or IPv6; "0.0.0.0" and "::": all of them.
    std::string host = "0.0.0.0";
    std::uint16_t port = 502;  // 0: any free port, see port()
    std::size_t max_connections = 32;
    bool may_write = true;                // false: writing functions are answered with exception 01
    std::vector<AccessRule> access = {};  // empty: everybody may connect and write
};

struct ServerStatistics {
    std::uint64_t accepted = 0;  // connections
    std::uint64_t evicted = 0;   // closed to make room for others
    std::uint64_t broken = 0;    // closed for bytes that are not Modbus
    std::uint64_t refused = 0;   // closed at once by the access rules, or because all others may write
    std::uint64_t requests = 0, exceptions = 0;
    std::size_t connections = 0;  // now
};

class Server {
  public:
    // Loop thread. Serves at once. `loop` and `model` outlive the server. Fails with busy (the port is
    // taken), refused (this user may not open it), not_found (no such address on this machine),
    // invalid_argument, io, unsupported (a loop in virtual time).
    [[nodiscard]] static Result<std::unique_ptr<Server>> open(hal::EventLoop& loop, RegisterModel& model,
                                                              ServerOptions options);

    // The same with an open listening socket (systemd's socket activation). Takes ownership of it, also on failure.
    [[nodiscard]] static Result<std::unique_ptr<Server>> adopt(hal::EventLoop& loop, RegisterModel& model,
                                                               int listening_fd, ServerOptions options);

    // Loop thread. Closes every connection.
    ~Server();
    Server(const Server&) = delete;
    Server& operator=(const Server&) = delete;

    // Loop thread. Replaces the access rules; connections that they do not allow are closed.
    void set_access(std::vector<AccessRule> access);

    [[nodiscard]] std::string address() const;  // that it listens at: "127.0.0.1:502"
    [[nodiscard]] std::uint16_t port() const;
    [[nodiscard]] ServerStatistics statistics() const;  // loop thread

  private:
    struct Impl;
    explicit Server(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace hord::firmware::modbus
