#include "algo/frame/resample.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

namespace hord::algo {
namespace {

constexpr int kPhaseBits = 5;
constexpr int kLanes = 16;
constexpr int kWidestLenslet = 15 * 24 + 32;            // px: the largest bins, with their taps
constexpr double kSmallestBin = 0.5, kLargestBin = 24;  // px

std::int32_t fixed(double px) { return static_cast<std::int32_t>(std::floor(px * (1 << kPhaseBits) + 0.5)); }

// Shares of the pixels under a box of `width` px that starts `phase` / phases into the first of them, Q0.7, sum 128.
void box_weights(double width, int phase, int phases, std::span<std::uint8_t> out) {
    const double from = static_cast<double>(phase) / phases;
    const double to = from + width;
    int left = 128;
    std::size_t largest = 0;
    for (std::size_t k = 0; k < out.size(); ++k) {
        const auto pixel = static_cast<double>(k);
        const double covered = std::max(0.0, std::min(to, pixel + 1) - std::max(from, pixel));
        out[k] = static_cast<std::uint8_t>(std::floor(128 * covered / width + 0.5));
        left -= out[k];
        if (out[k] > out[largest]) largest = k;
    }
    out[largest] = static_cast<std::uint8_t>(out[largest] + left);  // remainder of rounding
}

}  // namespace

Result<Resampler> Resampler::create(const LensletGrid& grid, const BinLayout& layout) {
    if (auto fine = check(grid); !fine) return tl::unexpected(fine.error());
    Resampler out;
    out.extents_ = {grid.columns, grid.rows, layout.bins_i, layout.bins_j};
    if (auto fine = check(out.extents_); !fine) return tl::unexpected(fine.error());
    if (layout.offsets_px.size() != static_cast<std::size_t>(out.extents_.bins())) {
        return fail(
            ErrorCode::invalid_argument,
            std::to_string(layout.offsets_px.size()) + " places for " + std::to_string(out.extents_.bins()) + " bins",
            "give one place a bin");
    }
    const double box_x = layout.box_x_px;
    const double box_y = layout.box_y_px;
    for (const double box : {box_x, box_y}) {
        if (!(box >= kSmallestBin && box <= kLargestBin)) {
            return fail(ErrorCode::invalid_argument, "bins of " + std::to_string(box) + " px",
                        "choose the number of bins so that one is 0.5 to 24 px");
        }
    }
    out.width_px_ = grid.width_px;
    out.height_px_ = grid.height_px;
    out.taps_x_ = static_cast<int>(std::ceil(box_x)) + 1;
    out.taps_y_ = static_cast<int>(std::ceil(box_y)) + 1;
    out.weights_x_.resize(static_cast<std::size_t>(kPhases * out.taps_x_));
    out.weights_y_.resize(static_cast<std::size_t>(kPhases * out.taps_y_));
    for (int phase = 0; phase < kPhases; ++phase) {
        const auto part = [phase](std::vector<std::uint8_t>& weights, int taps) {
            return std::span(weights).subspan(static_cast<std::size_t>(phase * taps), static_cast<std::size_t>(taps));
        };
        box_weights(box_x, phase, kPhases, part(out.weights_x_, out.taps_x_));
        box_weights(box_y, phase, kPhases, part(out.weights_y_, out.taps_y_));
    }
    // Pixel k covers [k - 1/2, k + 1/2): the left edge of a box, counted from the left edge of pixel 0.
    Places places;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const PixelPoint centre = grid.centre_px(m, n);
            const bool near = std::abs(centre.x_px) < 1e6 && std::abs(centre.y_px) < 1e6;
            places.x.push_back(fixed(near ? centre.x_px + 0.5 - 0.5 * box_x : -1e6));
            places.y.push_back(fixed(near ? centre.y_px + 0.5 - 0.5 * box_y : -1e6));
        }
    }
    out.places_ = std::make_shared<const Places>(std::move(places));
    for (const PixelPoint& offset : layout.offsets_px) {
        out.offset_x_.push_back(fixed(offset.x_px));
        out.offset_y_.push_back(fixed(offset.y_px));
    }
    // Bins in rows and columns, each further right or down than the one before.
    const auto at = [&](const std::vector<std::int32_t>& offsets, int i, int j) {
        return offsets[static_cast<std::size_t>(j * layout.bins_i + i)];
    };
    bool regular = true;
    for (int j = 0; j < layout.bins_j; ++j) {
        for (int i = 0; i < layout.bins_i; ++i) {
            regular = regular && at(out.offset_x_, i, j) == at(out.offset_x_, i, 0) &&
                at(out.offset_y_, i, j) == at(out.offset_y_, 0, j);
            regular = regular && (i == 0 || at(out.offset_x_, i, 0) > at(out.offset_x_, i - 1, 0)) &&
                (j == 0 || at(out.offset_y_, 0, j) > at(out.offset_y_, 0, j - 1));
        }
    }
    out.reach_x_ =
        ((at(out.offset_x_, layout.bins_i - 1, 0) - at(out.offset_x_, 0, 0)) >> kPhaseBits) + 1 + out.taps_x_;
    if (regular && out.reach_x_ <= kWidestLenslet) {
        for (int i = 0; i < layout.bins_i; ++i) out.column_.push_back(at(out.offset_x_, i, 0));
        for (int j = 0; j < layout.bins_j; ++j) out.row_.push_back(at(out.offset_y_, 0, j));
        out.lanes_ = plan_lanes(out.column_, out.row_, out.weights_x_, out.weights_y_, out.taps_x_, out.taps_y_);
        out.decode_lanes_ = decode_lanes(out.lanes_);
    }
    return out;
}

// One bin: for bins at the frame's edge and layouts that are not rows and columns.
template <class Sample>
Sample Resampler::bin(const FrameView& raw, std::int32_t at_x, std::int32_t at_y) const {
    const int x = at_x >> kPhaseBits;
    const int y = at_y >> kPhaseBits;
    if (x < 0 || y < 0 || x + taps_x_ > width_px_ || y + taps_y_ > height_px_) return 0;
    const std::uint8_t* across = &weights_x_[static_cast<std::size_t>((at_x & (kPhases - 1)) * taps_x_)];
    const std::uint8_t* down = &weights_y_[static_cast<std::size_t>((at_y & (kPhases - 1)) * taps_y_)];
    std::uint32_t sum = 0;
    for (int row = 0; row < taps_y_; ++row) {
        const auto* from = reinterpret_cast<const Sample*>(raw.data + (y + row) * raw.stride_bytes) + x;
        std::uint32_t line = 0;
        for (int k = 0; k < taps_x_; ++k) line += static_cast<std::uint32_t>(across[k]) * from[k];
        sum += line * down[row];
    }
    return static_cast<Sample>((sum + (1U << 13U)) >> 14U);
}

// A lenslet inside the frame whose bins lie in rows and columns. Each row of bins first sums weighted raw rows, sixteen
// pixels at a time; then its bins sum the weighted columns. The same integers as bin().
template <class Sample>
void Resampler::decode_inside(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, Sample* out,
                              std::ptrdiff_t stride) const {
    // 8-bit samples times weights that sum to 128 fit 16 bits.
    using Sum = std::conditional_t<sizeof(Sample) == 1, std::uint16_t, std::uint32_t>;
    typedef Sample Samples __attribute__((vector_size(kLanes * sizeof(Sample))));
    typedef Sum Sums __attribute__((vector_size(kLanes * sizeof(Sum))));
    const int first = (place_x + column_[0]) >> kPhaseBits;
    Sum weighted[kWidestLenslet + kLanes];
    const std::uint8_t* across[kMaxBins];
    int from[kMaxBins];
    for (int i = 0; i < extents_.i; ++i) {
        const std::int32_t at = place_x + column_[static_cast<std::size_t>(i)];
        from[i] = (at >> kPhaseBits) - first;
        across[i] = &weights_x_[static_cast<std::size_t>((at & (kPhases - 1)) * taps_x_)];
    }
    for (int j = 0; j < extents_.j; ++j, out += stride) {
        const std::int32_t at_y = place_y + row_[static_cast<std::size_t>(j)];
        const std::uint8_t* down = &weights_y_[static_cast<std::size_t>((at_y & (kPhases - 1)) * taps_y_)];
        const std::byte* line = raw.data + (at_y >> kPhaseBits) * raw.stride_bytes +
            static_cast<std::ptrdiff_t>(first) * static_cast<std::ptrdiff_t>(sizeof(Sample));
        for (int x = 0; x < reach_x_; x += kLanes) {
            Sums sum{};
            for (int row = 0; row < taps_y_; ++row) {
                Samples samples;
                std::memcpy(&samples,
                            line + row * raw.stride_bytes +
                                static_cast<std::ptrdiff_t>(x) * static_cast<std::ptrdiff_t>(sizeof(Sample)),
                            sizeof samples);
                sum += __builtin_convertvector(samples, Sums) * static_cast<Sum>(down[row]);
            }
            std::memcpy(weighted + x, &sum, sizeof sum);
        }
        const auto add_up = [&](auto taps) {
            for (int i = 0; i < extents_.i; ++i) {
                std::uint32_t sum = 1U << 13U;
                for (int k = 0; k < taps; ++k) sum += static_cast<std::uint32_t>(across[i][k]) * weighted[from[i] + k];
                out[i] = static_cast<Sample>(sum >> 14U);
            }
        };
        if (taps_x_ == 3) add_up(std::integral_constant<int, 3>{});
        else if (taps_x_ == 4) add_up(std::integral_constant<int, 4>{});
        else add_up(taps_x_);
    }
}

// The same by whole rows of bins (algo/frame/resample_avx2.h); false if that is not possible. `room`: 16 samples may be
// written to each line of `out`.
bool Resampler::decode_8bit(const FrameView& raw, std::int32_t place_x, std::int32_t place_y, std::uint8_t* out,
                            std::ptrdiff_t line_stride, bool room) const {
    if (decode_lanes_ == nullptr) return false;
    const std::int32_t at_x = place_x + column_.front(), at_y = place_y + row_.front();
    const LanePlan::Phase& phase = lanes_.phases[static_cast<std::size_t>(at_x & (kPhases - 1))];
    const int x = at_x >> kPhaseBits, y = at_y >> kPhaseBits, last_y = (place_y + row_.back()) >> kPhaseBits;
    if (x < 0 || y < 0 || x + phase.second + LanePlan::kWindow > width_px_ || last_y + taps_y_ > height_px_)
        return false;
    const LanesOf8Bit lenslet{raw.data + y * raw.stride_bytes + x,
                              raw.stride_bytes,
                              at_y & (kPhases - 1),
                              row_,
                              weights_y_.data(),
                              taps_y_,
                              lanes_.row_phases};
    if (room) {
        decode_lanes_(lenslet, phase, out, line_stride);
        return true;
    }
    std::uint8_t apart[kMaxBins * kLanes];
    decode_lanes_(lenslet, phase, apart, kLanes);
    for (int j = 0; j < extents_.j; ++j) std::copy_n(apart + j * kLanes, extents_.i, out + j * line_stride);
    return true;
}

// `room`: as above.
template <class Sample>
void Resampler::decode_any(const FrameView& raw, std::size_t lenslet, Sample* out, std::ptrdiff_t line_stride,
                           bool room) const {
    const std::int32_t place_x = places_->x[lenslet], place_y = places_->y[lenslet];
    if constexpr (sizeof(Sample) == 1) {
        if (decode_8bit(raw, place_x, place_y, out, line_stride, room)) return;
    }
    if (!column_.empty()) {
        const int x = (place_x + column_.front()) >> kPhaseBits;
        const int y = (place_y + row_.front()) >> kPhaseBits;
        const int last_y = (place_y + row_.back()) >> kPhaseBits;
        if (x >= 0 && y >= 0 && x + (reach_x_ + kLanes - 1) / kLanes * kLanes <= width_px_ &&
            last_y + taps_y_ <= height_px_)
            return decode_inside(raw, place_x, place_y, out, line_stride);
    }
    for (int j = 0; j < extents_.j; ++j) {
        for (int i = 0; i < extents_.i; ++i) {
            const auto k = static_cast<std::size_t>(j * extents_.i + i);
            out[j * line_stride + i] = bin<Sample>(raw, place_x + offset_x_[k], place_y + offset_y_[k]);
        }
    }
}

// Samples written beyond a lenslet's bins are overwritten by those that follow, if there are enough of them: in the
// same line, or, lenslet after lenslet, in the next ones.
template <class Sample>
void Resampler::decode_row(const FrameView& raw, int n, Sample* out, std::ptrdiff_t line_stride) const {
    for (int m = 0; m < extents_.m; ++m)
        decode_any(raw, extents_.index(m, n), out + m * extents_.i, line_stride,
                   m * extents_.i + kLanes <= extents_.width_px());
}

template <class Sample>
void Resampler::decode_row_by_lenslet(const FrameView& raw, int n, int first, int last, Sample* out) const {
    const std::ptrdiff_t bins = extents_.bins(), last_line = std::ptrdiff_t{extents_.j - 1} * extents_.i;
    for (int m = first; m <= last; ++m)
        decode_any(raw, extents_.index(m, n), out + m * bins, extents_.i,
                   m * bins + last_line + kLanes <= (last + 1) * bins);
}

template <class Sample>
void Resampler::decode_lenslet(const FrameView& raw, int m, int n, Sample* out, std::ptrdiff_t line_stride) const {
    decode_any(raw, extents_.index(m, n), out, line_stride, false);
}

template void Resampler::decode_row(const FrameView&, int, std::uint8_t*, std::ptrdiff_t) const;
template void Resampler::decode_row(const FrameView&, int, std::uint16_t*, std::ptrdiff_t) const;
template void Resampler::decode_row_by_lenslet(const FrameView&, int, int, int, std::uint8_t*) const;
template void Resampler::decode_row_by_lenslet(const FrameView&, int, int, int, std::uint16_t*) const;
template void Resampler::decode_lenslet(const FrameView&, int, int, std::uint8_t*, std::ptrdiff_t) const;
template void Resampler::decode_lenslet(const FrameView&, int, int, std::uint16_t*, std::ptrdiff_t) const;

}  // namespace hord::algo
