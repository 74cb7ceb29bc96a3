// The raw frame of a Lytro camera's file (.lfp, .lfr): a container of sections, a table of contents in JSON, and packed
// samples. First generation: 12 bits, two samples in three bytes. Illum: 10 bits, four samples in five bytes.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

[[nodiscard]] bool is_lytro(std::span<const std::byte> bytes);

// The sensor's frame as it is: under its colour filters, not demosaiced. Fails with unreadable (damaged, truncated),
// unsupported (no raw frame in it, another packing). `name` is used in the message.
Result<Frame> decode_lytro(std::span<const std::byte> bytes, std::string_view name);

}  // namespace hord::firmware
