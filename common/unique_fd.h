// Owns a file descriptor and closes it.
#pragma once

#include <cerrno>
#include <utility>

#include <unistd.h>

namespace hord::common {

class UniqueFd {
  public:
    UniqueFd() = default;
    explicit UniqueFd(int fd) : fd_(fd) {}
    UniqueFd(UniqueFd&& other) noexcept : fd_(other.release()) {}
    UniqueFd& operator=(UniqueFd&& other) noexcept {
        reset(other.release());
        return *this;
    }
    ~UniqueFd() { reset(); }

    [[nodiscard]] int get() const { return fd_; }  // -1: none
    [[nodiscard]] explicit operator bool() const { return fd_ >= 0; }
    [[nodiscard]] int release() { return std::exchange(fd_, -1); }
    void reset(int fd = -1) {
        if (const int old = std::exchange(fd_, fd); old >= 0) ::close(old);
    }
    // For files that were written: closing may report a failed write. Returns 0 or errno.
    [[nodiscard]] int close() { return ::close(release()) == 0 ? 0 : errno; }

  private:
    int fd_ = -1;
};

}  // namespace hord::common
