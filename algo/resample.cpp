#include "algo/resample.h"

#include <algorithm>
#include <cmath>

namespace hord::algo {
namespace {

constexpr int kPhaseBits = 5;
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
    out[largest] = static_cast<std::uint8_t>(out[largest] + left);  // what rounding left over
}

}  // namespace

Result<Resampler> Resampler::create(const LensletGrid& grid, const BinLayout& layout) {
    if (auto fine = check(grid); !fine) return tl::unexpected(fine.error());
    Resampler out;
    out.extents_ = {grid.columns, grid.rows, layout.bins_i, layout.bins_j};
    if (auto fine = check(out.extents_); !fine) return tl::unexpected(fine.error());
    if (layout.offsets_px.size() != static_cast<std::size_t>(out.extents_.bins())) {
        return fail(ErrorCode::invalid_argument, std::to_string(layout.offsets_px.size()) + " places for " + std::to_string(out.extents_.bins()) + " bins",
                    "give one place a bin");
    }
    const double box_x = layout.box_x_px;
    const double box_y = layout.box_y_px;
    for (const double box : {box_x, box_y}) {
        if (!(box >= kSmallestBin && box <= kLargestBin)) {
            return fail(ErrorCode::invalid_argument, "bins of " + std::to_string(box) + " px", "choose the number of bins so that one is 0.5 to 24 px");
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
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const PixelPoint centre = grid.centre_px(m, n);
            const bool near = std::abs(centre.x_px) < 1e6 && std::abs(centre.y_px) < 1e6;
            out.place_x_.push_back(fixed(near ? centre.x_px + 0.5 - 0.5 * box_x : -1e6));
            out.place_y_.push_back(fixed(near ? centre.y_px + 0.5 - 0.5 * box_y : -1e6));
        }
    }
    for (const PixelPoint& offset : layout.offsets_px) {
        out.offset_x_.push_back(fixed(offset.x_px));
        out.offset_y_.push_back(fixed(offset.y_px));
    }
    return out;
}

template <class Sample>
void Resampler::decode_lenslets(const FrameView& raw, int n, std::span<std::uint16_t> out) const {
    const int bins_i = extents_.i;
    const int stride = extents_.m * bins_i;
    for (int m = 0; m < extents_.m; ++m) {
        const auto lenslet = static_cast<std::size_t>(n) * static_cast<std::size_t>(extents_.m) + static_cast<std::size_t>(m);
        for (int j = 0; j < extents_.j; ++j) {
            for (int i = 0; i < bins_i; ++i) {
                const auto bin = static_cast<std::size_t>(j * bins_i + i);
                const std::int32_t at_x = place_x_[lenslet] + offset_x_[bin];
                const std::int32_t at_y = place_y_[lenslet] + offset_y_[bin];
                const int x = at_x >> kPhaseBits;
                const int y = at_y >> kPhaseBits;
                std::uint16_t& to = out[static_cast<std::size_t>(j * stride + m * bins_i + i)];
                if (x < 0 || y < 0 || x + taps_x_ > width_px_ || y + taps_y_ > height_px_) {
                    to = 0;
                    continue;
                }
                const std::uint8_t* across = &weights_x_[static_cast<std::size_t>((at_x & (kPhases - 1)) * taps_x_)];
                const std::uint8_t* down = &weights_y_[static_cast<std::size_t>((at_y & (kPhases - 1)) * taps_y_)];
                std::uint32_t sum = 0;
                for (int row = 0; row < taps_y_; ++row) {
                    const auto* from = reinterpret_cast<const Sample*>(raw.data + (y + row) * raw.stride_bytes) + x;
                    std::uint32_t line = 0;
                    for (int k = 0; k < taps_x_; ++k) line += static_cast<std::uint32_t>(across[k]) * from[k];
                    sum += line * down[row];
                }
                to = static_cast<std::uint16_t>((sum + (1U << 13U)) >> 14U);
            }
        }
    }
}

void Resampler::decode_row(const FrameView& raw, int n, std::span<std::uint16_t> out) const {
    if (raw.bits > 8) decode_lenslets<std::uint16_t>(raw, n, out);
    else decode_lenslets<std::uint8_t>(raw, n, out);
}

Result<Frame> Resampler::decode(const FrameView& raw) const {
    if (raw.width_px != width_px_ || raw.height_px != height_px_) {
        return fail(ErrorCode::invalid_argument,
                    "a frame of " + std::to_string(raw.width_px) + "x" + std::to_string(raw.height_px) + " px for a calibration of " +
                        std::to_string(width_px_) + "x" + std::to_string(height_px_),
                    "use the calibration of this camera and region");
    }
    Frame frame(extents_.width_px(), extents_.height_px(), raw.bits);
    std::vector<std::uint16_t> row(static_cast<std::size_t>(extents_.width_px()) * static_cast<std::size_t>(extents_.j));
    for (int n = 0; n < extents_.n; ++n) {
        decode_row(raw, n, row);
        std::size_t at = 0;
        for (int j = 0; j < extents_.j; ++j) {
            for (int x = 0; x < extents_.width_px(); ++x) frame.set(x, n * extents_.j + j, row[at++]);
        }
    }
    return frame;
}

}  // namespace hord::algo
