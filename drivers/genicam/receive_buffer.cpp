#include "drivers/genicam/receive_buffer.h"

#include <algorithm>

#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include "common/unique_fd.h"

namespace hord::drivers {

int set_receive_buffer(int socket, int bytes) {
    int given = 0;
    socklen_t size = sizeof given;
    if (::setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes) != 0 ||
        ::getsockopt(socket, SOL_SOCKET, SO_RCVBUF, &given, &size) != 0)
        return 0;
    return given / 2;  // the kernel doubles the value for its own use
}

int granted_receive_buffer(int bytes) {
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    return socket ? set_receive_buffer(socket.get(), bytes) : 0;
}

int udp_socket_on(std::uint16_t port) {
    rlimit limit{};
    const int end =
        ::getrlimit(RLIMIT_NOFILE, &limit) == 0 ? static_cast<int>(std::min<rlim_t>(limit.rlim_cur, 65'536)) : 1024;
    for (int fd = 0; fd < end; ++fd) {
        sockaddr_in own{};
        socklen_t size = sizeof own;
        int type = 0;
        socklen_t type_size = sizeof type;
        if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) == 0 && own.sin_family == AF_INET &&
            ntohs(own.sin_port) == port && ::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) == 0 &&
            type == SOCK_DGRAM)
            return fd;
    }
    return -1;
}

}  // namespace hord::drivers
