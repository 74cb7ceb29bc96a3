// Decodes a whole frame, row by row, with a Resampler or Regridder.
#pragma once

#include <vector>

#include "common/frame.h"

namespace hord::test {

template <class Decoder>
Frame decode_whole(Decoder& decoder, const FrameView& raw) {
    if constexpr (requires { decoder.begin_frame(); }) decoder.begin_frame();
    const auto& extents = decoder.extents();
    Frame frame(extents.width_px(), extents.height_px(), raw.bits);
    std::vector<std::uint16_t> row(static_cast<std::size_t>(extents.width_px() * extents.j));
    for (int n = 0; n < extents.n; ++n) {
        decoder.decode_row(raw, n, row);
        std::size_t k = 0;
        for (int j = 0; j < extents.j; ++j) {
            for (int x = 0; x < extents.width_px(); ++x) frame.set(x, n * extents.j + j, row[k++]);
        }
    }
    return frame;
}

}  // namespace hord::test
