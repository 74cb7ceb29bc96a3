// A fuzz target's input as a file, for readers that take a path.
#pragma once

#include <string>
#include <string_view>

#include <sys/mman.h>
#include <unistd.h>

#include "common/unique_fd.h"

namespace hord::fuzz {

class InputFile {
  public:
    explicit InputFile(std::string_view bytes) : fd_(::memfd_create("input", MFD_CLOEXEC)) {
        if (::write(fd_.get(), bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) ::_exit(3);
    }
    [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(fd_.get()); }

  private:
    common::UniqueFd fd_;
};

}  // namespace hord::fuzz
