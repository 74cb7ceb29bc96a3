// Decodes a raw frame of a real, rotated, distorted lenslet array into a macro-pixel frame, by fixed-point resampling.
//
// Each bin (i, j) of lenslet (m, n) is the mean of the raw pixels under a box of one bin about
//     centre(m, n) + r(i, j),
// with the centre from the calibration file and r from the direction map, which may be as bent as it likes
// (algo/frame/direction_map.h). Boxes are laid along the sensor's axes, as i and j are.
//
// Formats. A box is placed to 1/32 px; its weights along x and along y are Q0.7 each, both sum to exactly 128; a bin is
// (sum w_x w_y sample + 2^13) >> 14. Range: at most 2^16 - 1 in, so the sum is below 2^30 and the bin never exceeds the
// largest sample under it. Tables are built with + - * / and floor only, so that every machine builds the same ones.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/direction_map.h"
#include "algo/frame/extents.h"
#include "algo/frame/lenslet_grid.h"
#include "algo/frame/resample_avx2.h"
#include "common/frame.h"

namespace hord::algo {

class Resampler {
  public:
    // Takes all memory. Fails with invalid_argument for a grid that check() refuses, extents beyond
    // algo/frame/extents.h, or bins smaller than half a pixel or larger than 24.
    static Result<Resampler> create(const LensletGrid& grid, const BinLayout& layout);

    [[nodiscard]] const Extents& extents() const { return extents_; }

    // One row of lenslets: J image rows of I * M samples each, as a macro-pixel frame has them. Bins that reach beyond
    // the raw frame are 0: no light. `raw` must have the size the grid was made for; `out` holds J * I * M samples.
    void decode_row(const FrameView& raw, int n, std::span<std::uint16_t> out) const;

    // The same lenslets one after the other, each with its I * J bins, j outer.
    void decode_row_by_lenslet(const FrameView& raw, int n, std::span<std::uint16_t> out) const;

    // The whole frame, with the bit depth of `raw`. Fails with invalid_argument when the frame is not of the grid's
    // size.
    Result<Frame> decode(const FrameView& raw) const;

  private:
    static constexpr int kPhases = 32;
    template <class Sample>
    [[nodiscard]] std::uint16_t bin(const FrameView& raw, std::int32_t at_x, std::int32_t at_y) const;
    template <class Sample, class Sum>
    void decode_lenslet(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, std::uint16_t* out,
                        int stride) const;
    template <class Sample, class Sum>
    void decode_lenslets(const FrameView& raw, int n, std::uint16_t* out, int line_stride, int lenslet_stride) const;
    void decode_into(const FrameView& raw, int n, std::uint16_t* out, int line_stride, int lenslet_stride) const;

    Extents extents_;
    int width_px_ = 0, height_px_ = 0;
    int taps_x_ = 0, taps_y_ = 0;
    std::vector<std::uint8_t> weights_x_, weights_y_;  // kPhases x taps
    std::vector<std::int32_t> place_x_, place_y_;      // of every lenslet's centre, 1/32 px
    std::vector<std::int32_t> offset_x_, offset_y_;    // of every bin from it, 1/32 px
    std::vector<std::int32_t> column_, row_;           // the same where bins lie in rows and columns; else empty
    int reach_x_ = 0;                                  // pixels from the first bin's to behind the last one's
    LanePlan lanes_;                                   // of 8-bit samples; empty: they go the general way
    DecodeLanes decode_lanes_ = nullptr;
    [[nodiscard]] bool decode_8bit(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, std::uint16_t* out,
                                   std::ptrdiff_t line_stride, bool room) const;
};

}  // namespace hord::algo
