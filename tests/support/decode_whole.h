// Decodes a whole frame, row by row, with a Resampler or Regridder.
#pragma once

#include <cstddef>
#include <cstdint>

#include "common/frame.h"

namespace hord::test {

template <class Decoder>
Frame decode_whole(Decoder& decoder, const FrameView& raw) {
    if constexpr (requires { decoder.begin_frame(); }) decoder.begin_frame();
    const auto& extents = decoder.extents();
    Frame frame(extents.width_px(), extents.height_px(), raw.bits);
    const std::ptrdiff_t stride = frame.view().stride_bytes;
    for (int n = 0; n < extents.n; ++n) {
        std::byte* const line = frame.bytes().data() + std::ptrdiff_t{n} * extents.j * stride;
        if (raw.bits > 8) decoder.decode_row(raw, n, reinterpret_cast<std::uint16_t*>(line), stride / 2);
        else decoder.decode_row(raw, n, reinterpret_cast<std::uint8_t*>(line), stride);
    }
    return frame;
}

}  // namespace hord::test
