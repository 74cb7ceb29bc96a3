#include "algo/frame/decode.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>

#include "algo/simd/multiversion.h"
#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

// A line of a macro-pixel is processed as a vector of sixteen samples: its I bins and the samples to the right of them.
// The extra lanes are ignored; in the row of masses the next line or lenslet overwrites them.
constexpr int kLanes = 16;
static_assert(kLanes >= kMaxBins);

template <class T>
using Sixteen = Vector<T, kLanes * sizeof(T)>;

// Holds the sum of a column of masses, plain and weighted with the row (ranges: decode.h).
template <class Sample>
using Column = std::conditional_t<sizeof(Sample) == 1, std::int16_t, std::int32_t>;
static_assert(kMaxBins * (kMaxBins + 1) / 2 * 255 < 1 << 15);

// Output arrays, one entry a lenslet (mass: one a bin).
struct Decoded {
    std::uint16_t* mass;
    std::uint32_t* sum;
    std::int32_t *moment_x, *moment_y;
    std::uint8_t* mask;
};

// Horizontal sum, in vectors of `Bytes` bytes.
template <int Bytes, class Number>
HORD_ALWAYS_INLINE std::int32_t sum_of(const Sixteen<Number>& numbers) {
    std::int32_t wide[kLanes];
    store(__builtin_convertvector(numbers, Sixteen<std::int32_t>), wide);
    return Vec<std::int32_t, kLanes, Bytes>::load(wide).reduce_sum();
}
template <int Bytes, class Number>
HORD_ALWAYS_INLINE std::int32_t sum_of_products(const Sixteen<Number>& a, const Sixteen<std::int32_t>& b) {
    return sum_of<Bytes, std::int32_t>(__builtin_convertvector(a, Sixteen<std::int32_t>) * b);
}

// `samples`: the first sample of the first lenslet. Reads sixteen samples from the start of each line of each lenslet.
template <int Bytes, class Sample>
HORD_ALWAYS_INLINE void lenslets(const Sample* samples, std::ptrdiff_t line_stride, const Extents& extents,
                                 const LightLevels& levels, int count, Decoded to) {
    using Sums = Sixteen<Column<Sample>>;
    const int bins_i = extents.i, bins_j = extents.j;
    const Sixteen<Sample> dark = Sixteen<Sample>{} +
        static_cast<Sample>(std::min<std::uint32_t>(levels.dark, std::numeric_limits<Sample>::max()));
    const bool can_saturate = levels.saturated <= std::numeric_limits<Sample>::max();
    const Sixteen<Sample> saturated = Sixteen<Sample>{} +
        static_cast<Sample>(std::min<std::uint32_t>(levels.saturated, std::numeric_limits<Sample>::max()));
    Sixteen<Sample> inside{};
    Sums there{};                   // all bits set in lanes that are bins
    Sixteen<std::int32_t> place{};  // their positions, half bins from the centre
    for (int i = 0; i < bins_i; ++i) {
        inside[i] = std::numeric_limits<Sample>::max();
        there[i] = -1;
        place[i] = 2 * i - (bins_i - 1);
    }
    for (int m = 0; m < count; ++m, samples += bins_i) {
        Sixteen<Sample> peak{};
        Sums column{}, weighted{};  // sums of the columns; of the masses times (J - j)
        for (int j = 0; j < bins_j; ++j, to.mass += bins_i) {
            auto line = load<Sixteen<Sample>>(samples + j * line_stride);
            peak = max(peak, line);
            line = max(line, dark) - dark;
            store(__builtin_convertvector(line, Sixteen<std::uint16_t>), to.mass);
            column += __builtin_convertvector(line, Sums);
            weighted += column;
        }
        Sample peaks[kLanes];
        store(Sixteen<Sample>((max(peak, saturated) == peak) & inside), peaks);
        std::array<std::uint64_t, kLanes * sizeof(Sample) / 8> hot;
        std::memcpy(hot.data(), peaks, sizeof peaks);
        std::uint64_t any = 0;
        for (const std::uint64_t h : hot) any |= h;
        const std::int32_t sum = sum_of<Bytes, Column<Sample>>(column & there),
                           weighted_sum = sum_of<Bytes, Column<Sample>>(weighted & there);
        to.sum[m] = static_cast<std::uint32_t>(sum);
        to.moment_x[m] = sum_of_products<Bytes, Column<Sample>>(column, place);
        // 2j - (J-1) = (J+1) - 2(J-j)
        to.moment_y[m] = (bins_j + 1) * sum - 2 * weighted_sum;
        to.mask[m] = static_cast<std::uint8_t>((to.sum[m] < levels.min_sum ? kDark : kValid) |
                                               (can_saturate && any != 0 ? kSaturated : kValid));
    }
}

HORD_FOR_EACH_ISA(lenslets8, lenslets, std::uint8_t)
HORD_FOR_EACH_ISA(lenslets16, lenslets, std::uint16_t)

}  // namespace

HordRow::HordRow(const Extents& extents)
    : bins_(static_cast<std::size_t>(extents.bins())), masses_(static_cast<std::size_t>(extents.m) * bins_ + kLanes),
      sums_(static_cast<std::size_t>(extents.m)), moments_x_(sums_.size()), moments_y_(sums_.size()),
      mask_(sums_.size()) {}

Result<void> check_bits(int bits) {
    if (bits >= 8 && bits <= 16) return {};
    return fail(ErrorCode::invalid_argument, "samples of " + std::to_string(bits) + " bits", "use 8 to 16 bits");
}

Result<void> check_frame(const FrameView& frame, const Extents& extents, int bits) {
    const auto size_of = [](int width, int height) { return std::to_string(width) + "x" + std::to_string(height); };
    if (frame.width_px != extents.width_px() || frame.height_px != extents.height_px() || frame.bits != bits) {
        return fail(ErrorCode::invalid_argument,
                    "a frame of " + size_of(frame.width_px, frame.height_px) + " pixels at " +
                        std::to_string(frame.bits) + " bits",
                    "give one of " + size_of(extents.width_px(), extents.height_px()) + " at " + std::to_string(bits) +
                        ", as was set up");
    }
    const std::ptrdiff_t row_bytes = std::ptrdiff_t{frame.width_px} * frame.sample_bytes();
    if (frame.data == nullptr || std::abs(frame.stride_bytes) < row_bytes) {
        return fail(ErrorCode::invalid_argument,
                    "a frame whose rows are " + std::to_string(frame.stride_bytes) + " bytes apart",
                    "rows of this frame need " + std::to_string(row_bytes));
    }
    if (frame.bits > 8 && (reinterpret_cast<std::uintptr_t>(frame.data) % 2 != 0 || frame.stride_bytes % 2 != 0)) {
        return fail(ErrorCode::invalid_argument, "two-byte samples at an odd address",
                    "align the frame's rows to two bytes");
    }
    return {};
}

void decode_row(const FrameView& frame, const Extents& extents, const LightLevels& levels, int n, HordRow& row,
                Isa isa) {
    const auto decode = [&](auto kernel, auto sample) {
        using Sample = decltype(sample);
        const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
        const auto* first = reinterpret_cast<const Sample*>(frame.data) + n * extents.j * stride;
        const auto from = [&](int m) {
            const auto k = static_cast<std::size_t>(m);
            return Decoded{row.masses_.data() + k * row.bins_, row.sums_.data() + k, row.moments_x_.data() + k,
                           row.moments_y_.data() + k, row.mask_.data() + k};
        };
        // The last lenslets have fewer than sixteen samples before the end of the line: their samples are copied.
        const int in_place =
            frame.width_px < kLanes ? 0 : std::min((frame.width_px - kLanes) / extents.i + 1, extents.m);
        kernel(first, stride, extents, levels, in_place, from(0));
        for (int m = in_place; m < extents.m; ++m) {
            Sample copied[kMaxBins][kLanes] = {};
            for (int j = 0; j < extents.j; ++j) std::copy_n(first + m * extents.i + j * stride, extents.i, copied[j]);
            kernel(copied[0], kLanes, extents, levels, 1, from(m));
        }
    };
    if (frame.bits > 8) {
        decode(lenslets16(isa), std::uint16_t{});
    } else {
        decode(lenslets8(isa), std::uint8_t{});
    }
}

}  // namespace hord::algo
