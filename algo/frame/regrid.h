// From the lenslets of any lattice to a square, upright one: what the pipeline compares are neighbours to the right and
// below.
//
// The sensor's lenslets lie on a rotated, sheared, distorted, perhaps hexagonal lattice. The light field is wanted at
//     X(m, n) = first + pitch * (m, n)          px, along the sensor's axes,
// so each of its HORDs is the mean of those of the lenslets around X: three of a hexagonal lattice (barycentric weights
// in their triangle), four of a square one (bilinear). Mean deflections are interpolated linearly, and the mass of a
// HORD stays what it is.
//
// Formats. A weight is Q0.8, a lenslet's weights sum to exactly 256: a bin is (sum of w * sample + 128) >> 8, never
// above the largest of its samples. Weights are built with + - * / and floor only. Lattice rows are decoded once each,
// into a ring of as many as one output row touches. Where a lenslet around X is missing, the output has no light.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/resample.h"

namespace hord::algo {

class Regridder {
  public:
    // Takes all memory. The pitch is the grid's mean one, the first lenslet the first whole one of an upright frame.
    // Fails as Resampler::create does, and with invalid_argument where fewer than 3 x 3 lenslets result or the grid
    // cannot be inverted.
    static Result<Regridder> create(const LensletGrid& grid, const BinLayout& layout);

    [[nodiscard]] const Extents& extents() const { return extents_; }
    [[nodiscard]] double pitch_px() const { return pitch_px_; }
    [[nodiscard]] PixelPoint first_px() const { return first_px_; }

    // One row of lenslets, as Resampler::decode_row gives it. Any order of rows works; downwards is fastest.
    void decode_row(const FrameView& raw, int n, std::span<std::uint16_t> out);

    // To be called before the first row of another frame.
    void begin_frame();

    // The whole frame, with the bit depth of `raw`. Fails with invalid_argument when the frame is not of the grid's
    // size.
    Result<Frame> decode(const FrameView& raw);

    static constexpr int kAround = 4;
    // The lenslets around one place and their weights, Q0.8.
    struct Four {
        const std::uint16_t* from[kAround];
        std::uint32_t weight[kAround];
    };

  private:
    static constexpr std::size_t kRoom = 16;  // samples behind a buffer's end that whole vectors may touch
    struct Source {
        std::int16_t m[kAround], n[kAround];
        std::uint16_t weight[kAround];  // Q0.8; all 0: no light
    };
    static Source source_at(const LensletGrid& grid, LensletGrid::Uv where);
    const std::uint16_t* row(const FrameView& raw, int n);

    explicit Regridder(Resampler resampler) : resampler_(std::move(resampler)) {}
    Resampler resampler_;  // of the lattice
    Extents extents_;
    double pitch_px_ = 0;
    PixelPoint first_px_;
    int width_px_ = 0, height_px_ = 0;
    std::vector<Source> sources_;
    int ring_rows_ = 0;
    std::vector<int> ring_row_;                // which lattice row a place of the ring holds; -1: none
    std::vector<std::uint16_t> ring_, mixed_;  // and kRoom
    void (*mix_)(const Four&, int, std::uint16_t*) = nullptr;
    void (*mix_8bit_)(const Four&, int, std::uint16_t*) = nullptr;
};

}  // namespace hord::algo
