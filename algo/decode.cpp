#include "algo/decode.h"

#include <algorithm>
#include <array>
#include <utility>

namespace hord::algo {
namespace {

// One image line: I samples of every lenslet. `peak` and `sum` gather over the J lines of the row.
template <class Sample, int I>
void decode_line(const Sample* line, int lenslets, std::size_t bins, std::uint32_t dark, std::uint16_t* mass, std::uint32_t* sum,
                 std::uint16_t* peak) {
    for (int m = 0; m < lenslets; ++m, line += I, mass += bins) {
        std::uint32_t line_sum = 0;
        std::uint16_t line_peak = peak[m];
        for (int i = 0; i < I; ++i) {
            const std::uint16_t sample = line[i];
            line_peak = std::max(line_peak, sample);
            mass[i] = static_cast<std::uint16_t>(sample > dark ? sample - dark : 0U);
            line_sum += mass[i];
        }
        peak[m] = line_peak;
        sum[m] += line_sum;
    }
}

// decode_line for every number of bins, so that the inner loop has a constant length.
template <class Sample>
using LineDecoder = void (*)(const Sample*, int, std::size_t, std::uint32_t, std::uint16_t*, std::uint32_t*, std::uint16_t*);

template <class Sample, int... Bins>
constexpr auto line_decoders(std::integer_sequence<int, Bins...>) {
    return std::array<LineDecoder<Sample>, sizeof...(Bins)>{&decode_line<Sample, kMinBins + Bins>...};
}
constexpr auto kEveryBinCount = std::make_integer_sequence<int, kMaxBins - kMinBins + 1>{};
constexpr auto kDecode8 = line_decoders<std::uint8_t>(kEveryBinCount);
constexpr auto kDecode16 = line_decoders<std::uint16_t>(kEveryBinCount);

}  // namespace

void decode_row(const FrameView& frame, const Extents& extents, const LightLevels& levels, int n, HordRow& row) {
    std::fill(row.sums_.begin(), row.sums_.end(), 0U);
    std::fill(row.peaks_.begin(), row.peaks_.end(), std::uint16_t{0});
    const auto which = static_cast<std::size_t>(extents.i - kMinBins);
    for (int j = 0; j < extents.j; ++j) {
        const int y = n * extents.j + j;
        std::uint16_t* mass = row.masses_.data() + j * extents.i;
        if (frame.bits > 8) {
            kDecode16[which](frame.row16(y), extents.m, row.bins_, levels.dark, mass, row.sums_.data(), row.peaks_.data());
        } else {
            kDecode8[which](frame.row8(y), extents.m, row.bins_, levels.dark, mass, row.sums_.data(), row.peaks_.data());
        }
    }
    for (std::size_t m = 0; m < row.mask_.size(); ++m) {
        row.mask_[m] = static_cast<std::uint8_t>((row.sums_[m] < levels.min_sum ? kDark : kValid) |
                                                 (row.peaks_[m] >= levels.saturated ? kSaturated : kValid));
    }
}

}  // namespace hord::algo
