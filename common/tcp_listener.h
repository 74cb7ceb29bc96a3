// TCP: listening sockets, addresses as text, host names.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <sys/socket.h>

#include "common/result.h"
#include "common/unique_fd.h"

namespace hord::common {

// A non-blocking socket that listens. `what` names the service in messages ("Modbus"). `host`: an address of this
// machine, IPv4 or IPv6, or "localhost"; "0.0.0.0" and "::": all of them. Port 0: any free one. Fails with busy (the
// port is taken), refused (this user may not open it), not_found (no such address here), invalid_argument, io.
Result<UniqueFd> listen_on(std::string_view what, const std::string& host, std::uint16_t port);

// "192.0.2.7:50123", "[2001:db8::7]:50123"; of another family "?:?".
std::string address_text(const sockaddr_storage& address, socklen_t length);
// The text without its port.
std::string_view host_of(std::string_view address);

// Why `host` has no address: a name that cannot be resolved. Empty: it has one. Asks the system's resolver: may block.
std::string resolve_problem(const std::string& host);

// The address that the socket is bound to; of an invalid one empty.
std::string local_address(int fd);
// Its port; 0: it has none.
std::uint16_t local_port(int fd);

}  // namespace hord::common
