#include "tests/system/rig/cable.h"

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <random>
#include <stdexcept>

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace hord::rig {
namespace {

int open_raw(const std::string& device) {
    const int fd = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
    termios settings{};
    if (fd < 0 || tcgetattr(fd, &settings) != 0)
        throw std::runtime_error(device + " is no serial line: " + std::strerror(errno));
    cfmakeraw(&settings);
    settings.c_cflag |= PARENB | CLOCAL | CREAD;
    cfsetspeed(&settings, B19200);
    tcsetattr(fd, TCSANOW, &settings);
    return fd;
}

void write_all(int fd, const std::byte* data, std::size_t count) {
    while (count > 0) {
        const ssize_t done = ::write(fd, data, count);
        if (done > 0) {
            data += done;
            count -= static_cast<std::size_t>(done);
        } else if (done < 0 && errno != EAGAIN && errno != EINTR) {
            return;  // the other end is closed
        } else {
            pollfd room{fd, POLLOUT, 0};
            if (poll(&room, 1, 1000) == 0) return;
        }
    }
}

}  // namespace

Cable::Cable(const std::string& one, const std::string& other, std::uint64_t seed) {
    ends_[0] = open_raw(one);
    ends_[1] = open_raw(other);
    thread_ = std::thread([this, seed] { run(seed); });
}

Cable::~Cable() {
    stopping_ = true;
    thread_.join();
    for (const int end : ends_) close(end);
}

void Cable::run(std::uint64_t seed) {
    std::mt19937_64 chance(seed);
    std::array<std::byte, 256> piece;
    while (!stopping_) {
        std::array<pollfd, 2> ready = {{{ends_[0], POLLIN, 0}, {ends_[1], POLLIN, 0}}};
        if (poll(ready.data(), ready.size(), 50) <= 0) continue;
        for (std::size_t k = 0; k < 2; ++k) {
            if ((ready[k].revents & POLLIN) == 0) continue;
            const ssize_t count = ::read(ends_[k], piece.data(), piece.size());
            if (count <= 0) continue;
            if (hums_ && chance() % 8 == 0) {
                piece[chance() % static_cast<std::size_t>(count)] ^= std::byte{1};
                ++disturbed_;
            }
            if (hums_ && chance() % 4 == 0) {
                const auto noise = std::byte(chance() & 0xFFU);
                write_all(ends_[1 - k], &noise, 1);
                ++disturbed_;
            }
            write_all(ends_[1 - k], piece.data(), static_cast<std::size_t>(count));
        }
    }
}

}  // namespace hord::rig
