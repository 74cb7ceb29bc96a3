// Decodes raw frames of a calibrated sensor, with any lattice, into macro-pixel frames for the pipeline.
//
//     auto decoder = GridDecoder::create(grid, directions, 9, 9);  // allocates all memory
//     Frame frame = decoder->frame(raw.bits);                      // once
//     decoder->decode(raw, frame);                                 // each frame, no allocation
//
// A square lattice (nearly) parallel to the frame is decoded lenslet by lenslet (algo/frame/resample.h), without outer
// columns and rows that are not inside the frame. Any other lattice, hexagonal or rotated, is interpolated onto a
// square, upright one (algo/frame/regrid.h), because the pipeline compares neighbours to the right and below.
#pragma once

#include <cstddef>
#include <optional>
#include <variant>

#include "algo/frame/direction_map.h"
#include "algo/frame/extents.h"
#include "algo/frame/lenslet_grid.h"
#include "algo/frame/regrid.h"
#include "algo/frame/resample.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

class GridDecoder {
  public:
    // Bins as layout_of() with a direction map, as even_layout() without one. Fails as Resampler::create and
    // Regridder::create do.
    static Result<GridDecoder> create(const LensletGrid& grid, const std::optional<DirectionMap>& directions,
                                      int bins_i, int bins_j);

    [[nodiscard]] const Extents& extents() const { return extents_; }
    [[nodiscard]] double bin_px() const { return bin_px_; }    // one bin pitch on the sensor, mean of both axes
    [[nodiscard]] double bin_rad() const { return bin_rad_; }  // the same in radians; 0: no direction map
    [[nodiscard]] bool regrids() const { return std::holds_alternative<Regridder>(decoder_); }

    // A frame to decode into.
    [[nodiscard]] Frame frame(int bits) const { return {extents_.width_px(), extents_.height_px(), bits}; }

    // `out` must be made by frame(raw.bits). Does not allocate. Fails with invalid_argument if the raw frame is not of
    // the grid's size, its stride is too small, or `out` has another size or depth.
    Result<void> decode(const FrameView& raw, Frame& out);
    Result<Frame> decode(const FrameView& raw);

    // The steps of decode(), for callers that use a row while it is in cache, and for threads, each with a copy of the
    // decoder (copies share the tables). The raw frame has passed check(). Rows in any order; downwards is fastest.
    // `out`: the first of the J lines of lenslet row n, or of lenslet (m, n).
    [[nodiscard]] Result<void> check(const FrameView& raw) const;
    void begin_frame();
    void decode_row(const FrameView& raw, int n, std::byte* out, std::ptrdiff_t stride_bytes);
    void decode_lenslet(const FrameView& raw, int m, int n, std::byte* out, std::ptrdiff_t stride_bytes);

  private:
    using Decoder = std::variant<Resampler, Regridder>;
    GridDecoder(Decoder decoder, const LensletGrid& grid, const BinLayout& layout);

    Decoder decoder_;
    Extents extents_;
    int raw_width_px_, raw_height_px_;
    double bin_px_, bin_rad_;
};

}  // namespace hord::algo
