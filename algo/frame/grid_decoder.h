// Raw frames of one calibrated sensor as macro-pixel frames, whatever its lattice: what the pipeline judges.
//
//     auto decoder = GridDecoder::create(grid, directions, 9, 9);   // all memory
//     Frame frame = decoder->frame(raw.bits);                 // once
//     decoder->decode(raw, frame);                                  // each frame, nothing allocated
//
// The pipeline compares a lenslet with those to the right and below, and looks for free light along the field's
// outermost lenslets. A square lattice that lies (nearly) along the frame is read as it is, lenslet by lenslet
// (algo/frame/resample.h), without those of its outer columns and rows that are not inside the frame. Any other,
// hexagonal or turned, is read onto a square, upright one (algo/frame/regrid.h).
#pragma once

#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

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
    // With a direction map, bins are equal steps of direction about undeflected light; without one they divide the
    // pitch evenly about the lenslets' centres. Fails as Resampler::create and Regridder::create do.
    static Result<GridDecoder> create(const LensletGrid& grid, const std::optional<DirectionMap>& directions,
                                      int bins_i, int bins_j);

    [[nodiscard]] const Extents& extents() const { return extents_; }
    [[nodiscard]] double bin_px() const { return bin_px_; }  // one bin pitch on the sensor, mean of both axes
    [[nodiscard]] double bin_rad() const {
        return bin_rad_;
    }  // the same as a direction; 0: not known, no direction map
    [[nodiscard]] bool regrids() const { return std::holds_alternative<Regridder>(decoder_); }

    // A frame to decode into.
    [[nodiscard]] Frame frame(int bits) const { return {extents_.width_px(), extents_.height_px(), bits}; }

    // `out` is one of frame(raw.bits). Allocates nothing. Fails with invalid_argument when the raw frame is not of the
    // grid's size, its rows do not hold it, or `out` is another frame.
    Result<void> decode(const FrameView& raw, Frame& out);
    Result<Frame> decode(const FrameView& raw);

  private:
    using Decoder = std::variant<Resampler, Regridder>;
    GridDecoder(Decoder decoder, const LensletGrid& grid, const BinLayout& layout);

    Decoder decoder_;
    Extents extents_;
    int raw_width_px_, raw_height_px_;
    double bin_px_, bin_rad_;
    std::vector<std::uint16_t> row_;  // of lenslets: J image rows
};

}  // namespace hord::algo
