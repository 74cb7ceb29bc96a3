// The receive buffers of UDP sockets.
#pragma once

#include <cstdint>

namespace hord::drivers {

// Sets a receive buffer. Returns what the kernel gives, bytes: net.core.rmem_max limits it, and the service does not
// see /proc/sys. 0: the socket takes none.
int set_receive_buffer(int socket, int bytes);
int granted_receive_buffer(int bytes);  // what it gives a new socket

// This process's UDP socket on `port`; -1: none. Aravis does not give its stream's socket away.
int udp_socket_on(std::uint16_t port);

}  // namespace hord::drivers
