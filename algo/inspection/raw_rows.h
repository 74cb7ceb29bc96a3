// The rows of raw frames, decoded by one thread of a pipeline that uses each row while it is in cache.
//
// Bands of rows are shared out; a row beyond the thread's band, which its gradients need, is another thread's to write.
// It is decoded into a row of its own.
#pragma once

#include <algorithm>
#include <cstddef>

#include "algo/frame/grid_decoder.h"
#include "common/frame.h"

namespace hord::algo {

class RawRows {
  public:
    // Allocates all memory.
    RawRows(const GridDecoder& decoder, int bits)
        : decoder_(decoder), beyond_(decoder.extents().width_px(), decoder.extents().j, bits) {}

    void begin_frame() {
        decoder_.begin_frame();
        beyond_row_ = -1;
    }

    // Row n of a checked raw frame into `out`, a whole macro-pixel frame.
    void decode(const FrameView& raw, int n, Frame& out) {
        decoder_.decode_row(raw, n, lines_of(out, n), out.view().stride_bytes);
    }
    // Row n into a frame of one row, valid until the next call.
    FrameView decode_beyond(const FrameView& raw, int n) {
        decoder_.decode_row(raw, n, beyond_.bytes().data(), beyond_.view().stride_bytes);
        beyond_row_ = n;
        return beyond_.view();
    }
    // Copies row n, the last that decode_beyond() decoded, into `out`.
    void copy_beyond(int n, Frame& out) {
        if (beyond_row_ == n) std::ranges::copy(beyond_.bytes(), lines_of(out, n));
    }
    void decode_lenslet(const FrameView& raw, int m, int n, Frame& out) {
        decoder_.decode_lenslet(raw, m, n, lines_of(out, n) + std::ptrdiff_t{m} * line_bytes(out),
                                out.view().stride_bytes);
    }
    [[nodiscard]] Result<void> check(const FrameView& raw) const { return decoder_.check(raw); }

  private:
    std::byte* lines_of(Frame& out, int n) const {
        return out.bytes().data() + std::ptrdiff_t{n} * decoder_.extents().j * out.view().stride_bytes;
    }
    [[nodiscard]] std::ptrdiff_t line_bytes(const Frame& out) const {  // of a lenslet
        return std::ptrdiff_t{decoder_.extents().i} * out.view().sample_bytes();
    }

    GridDecoder decoder_;
    Frame beyond_;
    int beyond_row_ = -1;
};

}  // namespace hord::algo
