// Decodes a raw frame of a rotated, distorted lenslet array into a macro-pixel frame, by fixed-point resampling.
//
// Each bin (i, j) of lenslet (m, n) is the mean of the raw pixels under a box of one bin about
//     centre(m, n) + r(i, j),
// with the centre from the calibration file and r from the direction map (algo/frame/direction_map.h). Boxes are
// parallel to the sensor's axes.
//
// Formats. A box is positioned to 1/32 px. Its weights along x and along y are Q0.7 and sum to exactly 128. A bin is
// (sum w_x w_y sample + 2^13) >> 14. Range: samples are at most 2^16 - 1, so the sum is below 2^30 and the bin never
// exceeds the largest sample under it. Tables are computed with + - * / and floor only: the same on every machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "algo/frame/direction_map.h"
#include "algo/frame/extents.h"
#include "algo/frame/lenslet_grid.h"
#include "algo/frame/resample_avx2.h"
#include "common/frame.h"

namespace hord::algo {

class Resampler {
  public:
    // Allocates all memory. Fails with invalid_argument for a grid that check() refuses, extents beyond
    // algo/frame/extents.h, or bins smaller than half a pixel or larger than 24.
    static Result<Resampler> create(const LensletGrid& grid, const BinLayout& layout);

    [[nodiscard]] const Extents& extents() const { return extents_; }

    // Decodes lenslet row n: J image rows of I * M samples each, `line_stride` samples apart. Bins that reach beyond
    // the raw frame are 0. `raw` must have the size of the grid's frame. Sample: std::uint8_t for frames of 8 bits,
    // else std::uint16_t.
    template <class Sample>
    void decode_row(const FrameView& raw, int n, Sample* out, std::ptrdiff_t line_stride) const;

    // The same, lenslet after lenslet, each with its I * J bins, j outer: lenslets `first` to `last`, each in its place
    // of a whole row.
    template <class Sample>
    void decode_row_by_lenslet(const FrameView& raw, int n, int first, int last, Sample* out) const;

    // Lenslet (m, n) alone.
    template <class Sample>
    void decode_lenslet(const FrameView& raw, int m, int n, Sample* out, std::ptrdiff_t line_stride) const;

  private:
    static constexpr int kPhases = 32;
    template <class Sample>
    [[nodiscard]] Sample bin(const FrameView& raw, std::int32_t at_x, std::int32_t at_y) const;
    template <class Sample>
    void decode_inside(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, Sample* out,
                       std::ptrdiff_t stride) const;
    template <class Sample>
    void decode_any(const FrameView& raw, std::size_t lenslet, Sample* out, std::ptrdiff_t line_stride,
                    bool room) const;

    Extents extents_;
    int width_px_ = 0, height_px_ = 0;
    int taps_x_ = 0, taps_y_ = 0;
    std::vector<std::uint8_t> weights_x_, weights_y_;  // kPhases x taps
    struct Places {
        std::vector<std::int32_t> x, y;
    };
    std::shared_ptr<const Places> places_;           // of every lenslet's centre, 1/32 px; copies share it
    std::vector<std::int32_t> offset_x_, offset_y_;  // of every bin from it, 1/32 px
    std::vector<std::int32_t> column_, row_;         // the same if bins lie in rows and columns; else empty
    int reach_x_ = 0;                                // pixels under all bins of a row
    LanePlan lanes_;                                 // for 8-bit samples; empty: the general path is used
    DecodeLanes decode_lanes_ = nullptr;
    [[nodiscard]] bool decode_8bit(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, std::uint8_t* out,
                                   std::ptrdiff_t line_stride, bool room) const;
};

}  // namespace hord::algo
