#include "algo/frame/grid_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace hord::algo {
namespace {

constexpr int kMaxDropped = 4;           // outer columns and rows together; with more the lattice counts as rotated
constexpr double kInsidePitches = 0.25;  // centre to frame edge: then all undeflected light is in the frame

// The lenslets from (first_m, first_n), `columns` x `rows` of them, as a grid of their own.
LensletGrid part_of(const LensletGrid& grid, int first_m, int first_n, int columns, int rows) {
    LensletGrid part = grid;
    part.origin_u -= first_m;
    part.origin_v -= first_n;
    part.columns = columns;
    part.rows = rows;
    if (grid.shifts_px.empty()) return part;
    part.shifts_px.clear();
    for (int n = first_n; n < first_n + rows; ++n) {
        const auto row = grid.shifts_px.begin() + static_cast<std::ptrdiff_t>(n) * grid.columns + first_m;
        part.shifts_px.insert(part.shifts_px.end(), row, row + columns);
    }
    return part;
}

// A square lattice without outer columns and rows outside the frame; none if more than kMaxDropped would be removed.
std::optional<LensletGrid> upright_part(const LensletGrid& grid, double pitch_px) {
    if (grid.stagger != Stagger::none) return std::nullopt;
    const double margin = kInsidePitches * pitch_px - 0.5;
    const auto outside = [&](int m, int n) {
        const PixelPoint at = grid.centre_px(m, n);
        return !(at.x_px >= margin && at.y_px >= margin && at.x_px <= grid.width_px - 1 - margin &&
                 at.y_px <= grid.height_px - 1 - margin);
    };
    int left = 0, right = grid.columns - 1, top = 0, bottom = grid.rows - 1;
    for (int dropped = 0;; ++dropped) {
        if (right - left + 1 < kMinLenslets || bottom - top + 1 < kMinLenslets) return std::nullopt;
        int at_left = 0, at_right = 0, at_top = 0, at_bottom = 0;
        for (int n = top; n <= bottom; ++n) {
            at_left += outside(left, n) ? 1 : 0;
            at_right += outside(right, n) ? 1 : 0;
        }
        for (int m = left; m <= right; ++m) {
            at_top += outside(m, top) ? 1 : 0;
            at_bottom += outside(m, bottom) ? 1 : 0;
        }
        const int most = std::max({at_left, at_right, at_top, at_bottom});
        if (most == 0) return part_of(grid, left, top, right - left + 1, bottom - top + 1);
        if (dropped == kMaxDropped) return std::nullopt;
        if (at_left == most) ++left;
        else if (at_right == most) --right;
        else if (at_top == most) ++top;
        else --bottom;
    }
}

}  // namespace

GridDecoder::GridDecoder(Decoder decoder, const LensletGrid& grid, const BinLayout& layout)
    : decoder_(std::move(decoder)), extents_(std::visit([](const auto& one) { return one.extents(); }, decoder_)),
      raw_width_px_(grid.width_px), raw_height_px_(grid.height_px), bin_px_(0.5 * (layout.box_x_px + layout.box_y_px)),
      bin_rad_(std::sqrt(layout.step_i_rad * layout.step_j_rad)) {}

Result<GridDecoder> GridDecoder::create(const LensletGrid& grid, const std::optional<DirectionMap>& directions,
                                        int bins_i, int bins_j) {
    if (auto fine = algo::check(grid); !fine) return tl::unexpected(fine.error());
    if (auto fine = algo::check({kMinLenslets, kMinLenslets, bins_i, bins_j}); !fine)
        return tl::unexpected(fine.error());
    const BinLayout layout =
        directions ? layout_of(grid, *directions, bins_i, bins_j) : even_layout(grid, bins_i, bins_j);
    if (const auto upright = upright_part(grid, layout.box_x_px * bins_i)) {
        auto resampler = Resampler::create(*upright, layout);
        if (!resampler) return tl::unexpected(resampler.error());
        return GridDecoder(std::move(*resampler), grid, layout);
    }
    auto regridder = Regridder::create(grid, layout);
    if (!regridder) return tl::unexpected(regridder.error());
    return GridDecoder(std::move(*regridder), grid, layout);
}

Result<void> GridDecoder::check(const FrameView& raw) const {
    const auto size_of = [](int width, int height) { return std::to_string(width) + "x" + std::to_string(height); };
    if (raw.width_px != raw_width_px_ || raw.height_px != raw_height_px_) {
        return fail(ErrorCode::invalid_argument,
                    "a frame of " + size_of(raw.width_px, raw.height_px) + " px for a calibration of " +
                        size_of(raw_width_px_, raw_height_px_),
                    "use the calibration of this camera and region");
    }
    if (raw.bits < 8 || raw.bits > 16 || raw.data == nullptr ||
        std::abs(raw.stride_bytes) < std::ptrdiff_t{raw.width_px} * raw.sample_bytes() ||
        (raw.bits > 8 && (reinterpret_cast<std::uintptr_t>(raw.data) % 2 != 0 || raw.stride_bytes % 2 != 0))) {
        return fail(ErrorCode::invalid_argument, "a frame whose rows do not hold its samples",
                    "give rows of " + size_of(raw.width_px, raw.height_px) + " samples, two-byte ones aligned");
    }
    return {};
}

void GridDecoder::begin_frame() {
    if (auto* regridder = std::get_if<Regridder>(&decoder_)) regridder->begin_frame();
}

void GridDecoder::decode_row(const FrameView& raw, int n, std::byte* out, std::ptrdiff_t stride_bytes) {
    std::visit(
        [&](auto& decoder) {
            if (raw.bits > 8) decoder.decode_row(raw, n, reinterpret_cast<std::uint16_t*>(out), stride_bytes / 2);
            else decoder.decode_row(raw, n, reinterpret_cast<std::uint8_t*>(out), stride_bytes);
        },
        decoder_);
}

void GridDecoder::decode_lenslet(const FrameView& raw, int m, int n, std::byte* out, std::ptrdiff_t stride_bytes) {
    std::visit(
        [&](auto& decoder) {
            if (raw.bits > 8)
                decoder.decode_lenslet(raw, m, n, reinterpret_cast<std::uint16_t*>(out), stride_bytes / 2);
            else decoder.decode_lenslet(raw, m, n, reinterpret_cast<std::uint8_t*>(out), stride_bytes);
        },
        decoder_);
}

Result<void> GridDecoder::decode(const FrameView& raw, Frame& out) {
    if (auto fine = check(raw); !fine) return fine;
    if (out.width_px() != extents_.width_px() || out.height_px() != extents_.height_px() || out.bits() != raw.bits) {
        return fail(ErrorCode::invalid_argument, "a macro-pixel frame of another size or depth to decode into",
                    "take GridDecoder::frame()");
    }
    begin_frame();
    const std::ptrdiff_t stride = out.view().stride_bytes;
    for (int n = 0; n < extents_.n; ++n)
        decode_row(raw, n, out.bytes().data() + std::ptrdiff_t{n} * extents_.j * stride, stride);
    return {};
}

Result<Frame> GridDecoder::decode(const FrameView& raw) {
    Frame out = frame(raw.bits);
    if (auto done = decode(raw, out); !done) return tl::unexpected(done.error());
    return out;
}

}  // namespace hord::algo
