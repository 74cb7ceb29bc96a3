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

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
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

    // Decodes one row of lenslets, or lenslet (m, n) alone, as Resampler does. Rows in any order; downwards is fastest.
    template <class Sample>
    void decode_row(const FrameView& raw, int n, Sample* out, std::ptrdiff_t line_stride);
    template <class Sample>
    void decode_lenslet(const FrameView& raw, int m, int n, Sample* out, std::ptrdiff_t line_stride);

    // Call before the first row of every frame.
    void begin_frame();

    static constexpr int kAround = 4;
    // The lenslets around one point and their weights, Q0.8.
    template <class Sample>
    struct WeightedSources {
        const Sample* from[kAround];
        std::uint32_t weight[kAround];
    };

  private:
    static constexpr std::size_t kRoom = 16;  // samples behind a buffer's end, for whole vectors
    struct Source {
        std::int16_t m[kAround], n[kAround];
        std::uint16_t weight[kAround];  // Q0.8; all 0: no light
    };
    struct Range {
        int first = 0, last = -1;
        void cover(int at) {
            first = last < first ? at : std::min(first, at);
            last = std::max(last, at);
        }
    };
    // The same for all copies, which share it.
    struct Tables {
        std::vector<Source> sources;  // of every output lenslet
        std::vector<Range> rows;      // of every output row: the lattice rows that it needs
        std::vector<Range> columns;   // of every lattice row: its lenslets that some output lenslet needs
    };
    static Source source_at(const LensletGrid& grid, LensletGrid::Uv where);
    template <class Sample>
    [[nodiscard]] Sample* slot(int n);  // of lattice row n in the ring
    template <class Sample>
    void mix(const WeightedSources<Sample>& sources, Sample* out, std::ptrdiff_t line_stride, bool room);

    explicit Regridder(Resampler resampler) : resampler_(std::move(resampler)) {}
    Resampler resampler_;  // of the lattice
    Extents extents_;
    double pitch_px_ = 0;
    PixelPoint first_px_;
    std::shared_ptr<const Tables> tables_;
    int ring_rows_ = 0;
    std::vector<int> ring_row_;                // the lattice row in each slot of the ring; -1: none
    std::vector<std::ptrdiff_t> offsets_;      // of the current row's lattice rows in the ring, samples
    std::vector<std::uint16_t> ring_, mixed_;  // with kRoom samples behind; of 8-bit samples half is used
    void (*mix_)(const WeightedSources<std::uint16_t>&, int, std::uint16_t*) = nullptr;
    void (*mix_8bit_)(const WeightedSources<std::uint8_t>&, int, std::uint8_t*) = nullptr;
};

}  // namespace hord::algo
