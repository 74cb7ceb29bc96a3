#include "algo/decode.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

namespace hord::algo {
namespace {

// A line of a macro-pixel is worked on sixteen samples at a time: its I bins and, to the right of them, whatever follows.
// Those extra lanes are never looked at; in the row of masses they are overwritten by the line or the lenslet that comes next.
constexpr int kLanes = 16;
static_assert(kLanes >= kMaxBins);

template <class T>
struct LanesOf {
    typedef T Type __attribute__((vector_size(kLanes * sizeof(T))));
};
template <class T>
using Lanes = typename LanesOf<T>::Type;

}  // namespace

HordRow::HordRow(const Extents& extents)
    : bins_(static_cast<std::size_t>(extents.bins())), masses_(static_cast<std::size_t>(extents.m) * bins_ + kLanes),
      sums_(static_cast<std::size_t>(extents.m)), moments_x_(sums_.size()), moments_y_(sums_.size()), mask_(sums_.size()) {}

// `samples` is the lenslet's first; sixteen may be read from the start of each of its lines.
template <class Sample, class Column>
void HordRow::decode_lenslet(const Sample* samples, std::ptrdiff_t line_stride, const Extents& extents, const LightLevels& levels, std::size_t m) {
    const Lanes<Sample> dark = Lanes<Sample>{} + static_cast<Sample>(std::min<std::uint32_t>(levels.dark, std::numeric_limits<Sample>::max()));
    Lanes<Sample> peak{};
    Lanes<Column> column{}, weighted{};  // sums of the columns; of the masses times (J - j)
    std::uint16_t* mass = masses_.data() + m * bins_;
    for (int j = 0; j < extents.j; ++j, mass += extents.i) {
        Lanes<Sample> line;
        std::memcpy(&line, samples + j * line_stride, sizeof line);
        peak = line > peak ? line : peak;
        line = (line > dark ? line : dark) - dark;
        const auto wide = __builtin_convertvector(line, Lanes<std::uint16_t>);
        std::memcpy(mass, &wide, sizeof wide);
        column += __builtin_convertvector(line, Lanes<Column>);
        weighted += column;
    }
    std::uint32_t sum = 0, weighted_sum = 0, brightest = 0;
    std::int32_t moment_x = 0;
    for (int i = 0; i < extents.i; ++i) {
        sum += column[i];
        weighted_sum += weighted[i];
        moment_x += (2 * i - (extents.i - 1)) * static_cast<std::int32_t>(column[i]);
        brightest = std::max<std::uint32_t>(brightest, peak[i]);
    }
    sums_[m] = sum;
    moments_x_[m] = moment_x;
    // 2j - (J-1) = (J+1) - 2(J-j)
    moments_y_[m] = (extents.j + 1) * static_cast<std::int32_t>(sum) - 2 * static_cast<std::int32_t>(weighted_sum);
    mask_[m] = static_cast<std::uint8_t>((sum < levels.min_sum ? kDark : kValid) | (brightest >= levels.saturated ? kSaturated : kValid));
}

Result<void> check_bits(int bits) {
    if (bits >= 8 && bits <= 16) return {};
    return fail(ErrorCode::invalid_argument, "samples of " + std::to_string(bits) + " bits", "use 8 to 16 bits");
}

Result<void> check_frame(const FrameView& frame, const Extents& extents, int bits) {
    const auto size_of = [](int width, int height) { return std::to_string(width) + "x" + std::to_string(height); };
    if (frame.width_px != extents.width_px() || frame.height_px != extents.height_px() || frame.bits != bits) {
        return fail(ErrorCode::invalid_argument, "a frame of " + size_of(frame.width_px, frame.height_px) + " pixels at " + std::to_string(frame.bits) + " bits",
                    "give one of " + size_of(extents.width_px(), extents.height_px()) + " at " + std::to_string(bits) + ", as was set up");
    }
    const std::ptrdiff_t row_bytes = std::ptrdiff_t{frame.width_px} * frame.sample_bytes();
    if (frame.data == nullptr || std::abs(frame.stride_bytes) < row_bytes) {
        return fail(ErrorCode::invalid_argument, "a frame whose rows are " + std::to_string(frame.stride_bytes) + " bytes apart",
                    "rows of this frame need " + std::to_string(row_bytes));
    }
    if (frame.bits > 8 && (reinterpret_cast<std::uintptr_t>(frame.data) % 2 != 0 || frame.stride_bytes % 2 != 0)) {
        return fail(ErrorCode::invalid_argument, "two-byte samples at an odd address", "align the frame's rows to two bytes");
    }
    return {};
}

Hord decode_hord(const FrameView& frame, const Extents& extents, const LightLevels& levels, int m, int n, std::span<std::uint16_t> masses) {
    std::uint32_t sum = 0;
    std::size_t k = 0;
    for (int j = 0; j < extents.j; ++j) {
        for (int i = 0; i < extents.i; ++i, ++k) {
            const std::uint32_t sample = frame.sample(m * extents.i + i, n * extents.j + j);
            masses[k] = static_cast<std::uint16_t>(sample - std::min(sample, levels.dark));
            sum += masses[k];
        }
    }
    return {masses.data(), sum};
}

void decode_row(const FrameView& frame, const Extents& extents, const LightLevels& levels, int n, HordRow& row) {
    const auto decode = [&](auto sample, auto column) {
        using Sample = decltype(sample);
        using Column = decltype(column);
        const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
        const auto* first = reinterpret_cast<const Sample*>(frame.data) + n * extents.j * stride;
        // The last lenslets have fewer than sixteen samples before the end of the line: theirs are copied.
        const int lenslets_read_in_place = std::max(0, (frame.width_px - kLanes) / extents.i + 1);
        for (int m = 0; m < extents.m; ++m) {
            const Sample* samples = first + m * extents.i;
            if (m < lenslets_read_in_place) {
                row.decode_lenslet<Sample, Column>(samples, stride, extents, levels, static_cast<std::size_t>(m));
                continue;
            }
            Sample copied[kMaxBins][kLanes] = {};
            for (int j = 0; j < extents.j; ++j) std::copy_n(samples + j * stride, extents.i, copied[j]);
            row.decode_lenslet<Sample, Column>(copied[0], kLanes, extents, levels, static_cast<std::size_t>(m));
        }
    };
    if (frame.bits > 8) {
        decode(std::uint16_t{}, std::uint32_t{});
    } else {
        decode(std::uint8_t{}, std::uint16_t{});
    }
}

}  // namespace hord::algo
