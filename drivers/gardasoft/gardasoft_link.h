// The connection to a Gardasoft controller: TCP, or a serial line of 115200 baud, 8 bits, no parity. One exchange at a
// time. UDP is not used: a lost command would pass for one that was sent.
#pragma once

#include <string>
#include <string_view>

#include "common/result.h"
#include "common/unique_fd.h"
#include "drivers/gardasoft/gardasoft_options.h"
#include "drivers/gardasoft/gardasoft_protocol.h"

namespace hord::drivers {

class GardasoftLink {
  public:
    static constexpr hal::Duration kConnectTimeout = std::chrono::milliseconds(500);
    static constexpr std::size_t kMaxReply = 4096;  // bytes; a longer answer is none of a controller

    // Blocks until the connection is there. Fails with not_found, busy, timeout or disconnected.
    static Result<GardasoftLink> open(const GardasoftStrobeOptions& options);

    // Sends a command line and waits for its answer. Fails with timeout, disconnected, unreadable (no text that ends
    // with ">"), refused (the controller's "Err"). After any error but refused the link must be opened anew: an answer
    // may still be on its way.
    Result<std::string> ask(std::string_view command);
    // The same for a command that prints nothing or events; fails as gardasoft::acknowledged() does, too.
    Result<void> tell(std::string_view command) {
        return ask(command).and_then([&](const std::string& text) { return gardasoft::acknowledged(command, text); });
    }

  private:
    GardasoftLink(common::UniqueFd fd, std::string name, hal::Duration timeout)
        : fd_(std::move(fd)), name_(std::move(name)), timeout_(timeout) {}
    common::UniqueFd fd_;
    std::string name_;
    hal::Duration timeout_;
};

}  // namespace hord::drivers
