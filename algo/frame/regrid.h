// Interpolates the lenslets of any lattice (rotated, sheared, distorted, hexagonal) onto a square, upright one:
//
//     X(m, n) = first + pitch * (m, n)          px, along the sensor's axes
//
// Each output HORD is the weighted mean of those of the lenslets around X: three of a hexagonal lattice (barycentric
// weights), four of a square one (bilinear weights). This interpolates mean deflections linearly and keeps the total
// light. If a lenslet around X is missing, the output has no light.
//
// Formats. Weights are Q0.8 and sum to exactly 256: a bin is (sum of w * sample + 128) >> 8, never above its largest
// sample. Weights are computed with + - * / and floor only.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/resample.h"

namespace hord::algo {

class Regridder {
  public:
    // Allocates all memory. The pitch is the grid's mean pitch; as many lenslets as fit, in the middle of the frame.
    // Fails as Resampler::create does, and with invalid_argument if fewer than 3 x 3 lenslets result or the grid cannot
    // be inverted.
    static Result<Regridder> create(const LensletGrid& grid, const BinLayout& layout);

    [[nodiscard]] const Extents& extents() const { return extents_; }
    [[nodiscard]] double pitch_px() const { return pitch_px_; }
    [[nodiscard]] PixelPoint first_px() const { return first_px_; }

    // Decodes one row of lenslets, as Resampler::decode_row. Rows in any order; downwards is fastest.
    void decode_row(const FrameView& raw, int n, std::span<std::uint16_t> out);

    // Call before the first row of every frame.
    void begin_frame();

    static constexpr int kAround = 4;
    // The lenslets around one point and their weights, Q0.8.
    struct WeightedSources {
        const std::uint16_t* from[kAround];
        std::uint32_t weight[kAround];
    };

  private:
    static constexpr std::size_t kRoom = 16;  // samples behind a buffer's end, for whole vectors
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
    std::vector<Source> sources_;
    int ring_rows_ = 0;
    std::vector<int> ring_row_;                // the lattice row in each slot of the ring; -1: none
    std::vector<std::uint16_t> ring_, mixed_;  // with kRoom samples behind
    void (*mix_)(const WeightedSources&, int, std::uint16_t*) = nullptr;
    void (*mix_8bit_)(const WeightedSources&, int, std::uint16_t*) = nullptr;
};

}  // namespace hord::algo
