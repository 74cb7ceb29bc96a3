// A light barrier on an input of a GigE Vision camera: its edges as the camera's events (gvcp_events.h).
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "drivers/genicam/aravis.h"
#include "drivers/genicam/gvcp_events.h"

namespace hord::drivers {

// The event of an input's direction as the camera numbers it.
struct InputEvents {
    std::uint16_t rising = 0, falling = 0;
};

// Switches the events of both edges of `line` on. Fails with unsupported and invalid_argument: a camera without events,
// without these, or that does not number them.
Result<InputEvents> set_input_events(ArvDevice* device, const std::string& line);

// The camera's message channel, to a socket of this process, with a thread that answers it.
class MessageChannel {
  public:
    // Called on the thread of the channel.
    using Take = std::function<void(const GvcpMessage&)>;
    // Fails with unsupported (no GigE camera, or one without this channel) and io.
    static Result<std::unique_ptr<MessageChannel>> open(ArvDevice* device, Take take);
    virtual ~MessageChannel() = default;
};

}  // namespace hord::drivers
