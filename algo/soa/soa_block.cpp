#include "algo/soa/soa_block.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "algo/simd/vec.h"

namespace hord::algo {

constexpr int kLanes = SoaBlock::kLanes;
constexpr int kCacheLine = 64;                        // bytes
constexpr int kWindow = 8;                            // neighbouring bins transposed at once
constexpr int kColumns = kMaxBins - 1 + kWindow / 2;  // half a window may start at the last bin

namespace {

using Outputs = SoaBlock::Outputs;
using Bytes16 = Vector<std::uint8_t, 16>;

// One bit per byte of a mask.
HORD_ALWAYS_INLINE std::uint32_t mask_bits(const Bytes16& bytes) {
#if defined(__SSE2__)
    return static_cast<std::uint32_t>(_mm_movemask_epi8(reinterpret_cast<__m128i>(bytes)));
#else
    std::uint64_t halves[2];
    std::memcpy(halves, &bytes, sizeof halves);
    const auto eight = [](std::uint64_t of_bytes) {
        return ((of_bytes & 0x8040201008040201U) * 0x0101010101010101U) >> 56;
    };
    return static_cast<std::uint32_t>(eight(halves[0]) | eight(halves[1]) << 8);
#endif
}

// Bit k: sample k is above `dark`.
HORD_ALWAYS_INLINE std::uint32_t lit_bits(const Bytes16& samples, std::uint8_t dark) {
    return mask_bits(reinterpret_cast<Bytes16>(samples > Bytes16{} + dark));
}
HORD_ALWAYS_INLINE std::uint32_t lit_bits(const Vector<std::uint16_t, 32>& samples, std::uint16_t dark) {
    std::uint32_t bits = 0;
    for (int i = 0; i < kLanes; ++i) bits |= std::uint32_t{samples[i] > dark} << i;
    return bits;
}

// Whether one of `count` samples, or of the up to 63 bytes that follow, is above `dark`. Prefetches the samples `next`
// further on: the same ones of the next lenslet row.
template <int Bytes, class Sample>
HORD_ALWAYS_INLINE bool any_above(const Sample* samples, int count, Sample dark, std::ptrdiff_t next) {
    using Wide = Vector<Sample, Bytes>;
    using Narrow = Vector<Sample, 16>;
    constexpr int kOfOne = Bytes / static_cast<int>(sizeof(Sample)),
                  kOfLine = kCacheLine / static_cast<int>(sizeof(Sample));
    Wide most{};
    for (const Sample* end = samples + count; samples < end; samples += kOfLine) {
        __builtin_prefetch(samples + next);
        for (int at = 0; at < kOfLine; at += kOfOne) most = max(most, load<Wide>(samples + at));
    }
    Narrow parts[Bytes / 16];
    std::memcpy(parts, &most, sizeof parts);
    for (int p = 1; p < Bytes / 16; ++p) parts[0] = max(parts[0], parts[p]);
    return mask_bits(reinterpret_cast<Bytes16>(parts[0] > Narrow{} + dark)) != 0;
}

// Sixteen sums of bytes, even and odd lanes apart: at most 15 * 15 * 255 < 2^16.
struct EvenOdd {
    using Words = Vector<std::uint16_t, 16>;
    Words even, odd;

    HORD_ALWAYS_INLINE static EvenOdd of(const Bytes16& bytes) {
        const auto words = reinterpret_cast<Words>(bytes);
        return {words & 0xFFU, words >> 8U};
    }
    HORD_ALWAYS_INLINE EvenOdd operator+(const EvenOdd& b) const { return {even + b.even, odd + b.odd}; }
    HORD_ALWAYS_INLINE EvenOdd operator*(int factor) const {
        return {even * static_cast<std::uint16_t>(factor), odd * static_cast<std::uint16_t>(factor)};
    }
    HORD_ALWAYS_INLINE void store(std::uint16_t* to) const {
        algo::store(Words(__builtin_shufflevector(even, odd, 0, 8, 1, 9, 2, 10, 3, 11)), to);
        algo::store(Words(__builtin_shufflevector(even, odd, 4, 12, 5, 13, 6, 14, 7, 15)), to + 8);
    }
};

HORD_ALWAYS_INLINE Bytes16 interleaved_low(const Bytes16& a, const Bytes16& b) {
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
}
HORD_ALWAYS_INLINE Bytes16 interleaved_high(const Bytes16& a, const Bytes16& b) {
    return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
}

// Transposes eight neighbouring samples of sixteen lenslets, which are `apart` samples apart, into eight vectors of
// sixteen lenslets, and subtracts `dark` (of the eight bins, given twice). Four perfect shuffles of the 128 bytes; the
// last three separately for each half of the bins.
struct Transposition {
    Bytes16 once[8];

    HORD_ALWAYS_INLINE Transposition(const std::uint8_t* samples, int apart, const Bytes16& dark) {
        Bytes16 two[8];  // lenslets each
        for (int p = 0; p < 8; ++p) {
            std::uint64_t halves[2];
            std::memcpy(&halves[0], samples + 2 * p * apart, 8);
            std::memcpy(&halves[1], samples + (2 * p + 1) * apart, 8);
            std::memcpy(&two[p], halves, sizeof halves);
            two[p] = max(two[p], dark) - dark;
        }
        for (int k = 0; k < 4; ++k) {
            once[2 * k] = interleaved_low(two[k], two[k + 4]);
            once[2 * k + 1] = interleaved_high(two[k], two[k + 4]);
        }
    }
    template <bool kLast>
    HORD_ALWAYS_INLINE void four(Bytes16 (&out)[4]) const {
        Bytes16 twice[4], thrice[4];
        for (int k = 0; k < 4; ++k)
            twice[k] = kLast ? interleaved_high(once[k], once[k + 4]) : interleaved_low(once[k], once[k + 4]);
        for (int k = 0; k < 2; ++k) {
            thrice[2 * k] = interleaved_low(twice[k], twice[k + 2]);
            thrice[2 * k + 1] = interleaved_high(twice[k], twice[k + 2]);
        }
        for (int k = 0; k < 2; ++k) {
            out[2 * k] = interleaved_low(thrice[k], thrice[k + 2]);
            out[2 * k + 1] = interleaved_high(thrice[k], thrice[k + 2]);
        }
    }
};

// Per bin the maximum of sixteen lenslets. Lanes beyond bin I belong to other lenslets.
template <class Samples, class Sample>
HORD_ALWAYS_INLINE Samples brightest_of(const Sample* line, int apart) {
    Samples most[2] = {load<Samples>(line), load<Samples>(line + apart)};
    for (int l = 2; l < kLanes; l += 2) {
        most[0] = max(most[0], load<Samples>(line + l * apart));
        most[1] = max(most[1], load<Samples>(line + (l + 1) * apart));
    }
    return max(most[0], most[1]);
}

// Vectors of at most 32 bytes.
template <int Bytes>
using Ints = Vec<std::int32_t, kLanes, std::min(Bytes, 32)>;
template <int Bytes>
using Floats = Vec<float, kLanes, std::min(Bytes, 32)>;

HORD_ALWAYS_INLINE void add_lit(SoaBlock::Lit& all, int first, std::uint32_t bins) {
    all[static_cast<std::size_t>(first / 64)] |= std::uint64_t{bins} << (first % 64);
    if (first % 64 > 64 - kMaxBins) all[static_cast<std::size_t>(first / 64 + 1)] |= bins >> (64 - first % 64);
}

// Sums of one line; the moment is that along x.
template <class Sums>
struct LineSums {
    Sums mass, moment;  // for EvenOdd the moments are int16
};

// 8-bit: gathers the lit bins of a line by transposing the samples around them.
template <int Bytes>
HORD_ALWAYS_INLINE void gather_line(const std::uint8_t* line, int j, std::uint32_t lit, const Extents& extents,
                                    const std::uint8_t* darkness, Outputs outputs, int& count, EvenOdd* columns,
                                    LineSums<EvenOdd>& sums, SoaBlock& block) {
    const auto add_four = [&](const Bytes16(&four)[4], int first) __attribute__((always_inline)) {
        for (int k = 0; k < 4; ++k) {
            const auto masses = EvenOdd::of(four[k]);
            sums.mass = sums.mass + masses;
            if (outputs.moments) sums.moment = sums.moment + masses * (2 * (first + k) - (extents.i - 1));
            if (outputs.margins) columns[first + k] = columns[first + k] + masses;
            if (outputs.masses) {
                masses.store(block.mass[count]);
                block.bin[count] = static_cast<std::uint8_t>(j * extents.i + first + k);
                count += static_cast<int>((lit >> (first + k)) & 1U);
            }
        }
    };
    // Lit bins are close together: mostly the first half of one window holds them all. Bins beyond I become 0.
    for (int first = __builtin_ctz(lit); lit >> first != 0; first += kWindow) {
        std::uint64_t dark[2];
        std::memcpy(&dark[0], darkness + first, kWindow);
        dark[1] = dark[0];
        const Transposition bins(line + first, extents.i, load<Bytes16>(dark));
        Bytes16 four[4];
        bins.four<false>(four);
        add_four(four, first);
        if (lit >> (first + 4) == 0) break;
        bins.four<true>(four);
        add_four(four, first + 4);
    }
}

// 16-bit: gathers each lit bin on its own.
template <int Bytes>
HORD_ALWAYS_INLINE void gather_line(const std::uint16_t* line, int j, std::uint32_t lit, const Extents& extents,
                                    const std::uint16_t* darkness, Outputs outputs, int& count, Ints<Bytes>* columns,
                                    LineSums<Ints<Bytes>>& sums, SoaBlock& block) {
    using Words16 = Vector<std::uint16_t, 32>;
    const Words16 dark = Words16{} + darkness[0];
    for (; lit != 0; lit &= lit - 1) {
        const int i = __builtin_ctz(lit);
        std::uint16_t* const words = block.mass[count];
        for (int l = 0; l < kLanes; ++l) words[l] = line[l * extents.i + i];
        store(max(load<Words16>(words), dark) - dark, words);
        const auto masses = Ints<Bytes>::load_converted(words);
        sums.mass = sums.mass + masses;
        if (outputs.moments) sums.moment = sums.moment + masses * (2 * i - (extents.i - 1));
        if (outputs.margins) columns[i] = columns[i] + masses;
        if (outputs.masses) block.bin[count++] = static_cast<std::uint8_t>(j * extents.i + i);
    }
}

// Word: std::uint16_t or std::int16_t, how the sums are to be read.
template <int Bytes, class Word>
HORD_ALWAYS_INLINE Ints<Bytes> ints(const EvenOdd& sums) {
    std::uint16_t words[kLanes];
    sums.store(words);
    return Ints<Bytes>::load_converted(reinterpret_cast<const Word*>(words));
}
template <int Bytes, class Word>
HORD_ALWAYS_INLINE const Ints<Bytes>& ints(const Ints<Bytes>& sums) {
    return sums;
}

// Finds the bins that are lit in any of the sixteen lenslets, gathers them, and adds them up.
template <int Bytes, class Sample>
HORD_ALWAYS_INLINE void gather(const Sample* samples, std::ptrdiff_t stride, const Extents& extents,
                               const LightLevels& levels, Outputs outputs, SoaBlock& block) {
    using Samples = Vector<Sample, kLanes * sizeof(Sample)>;
    using Sums = std::conditional_t<sizeof(Sample) == 1, EvenOdd, Ints<Bytes>>;
    const int bins_i = extents.i, bins_j = extents.j;
    const auto dark = static_cast<Sample>(std::min<std::uint32_t>(levels.dark, std::numeric_limits<Sample>::max()));
    const bool can_saturate = levels.saturated <= std::numeric_limits<Sample>::max();
    std::uint32_t lit_lines = 0;
    for (int j = 0; j < bins_j; ++j) {
        lit_lines |= std::uint32_t{any_above<Bytes>(samples + j * stride, kLanes * bins_i, dark, bins_j * stride)} << j;
    }
    Sample darkness[kMaxBins + kWindow];
    for (int i = 0; i < kMaxBins + kWindow; ++i) darkness[i] = i < bins_i ? dark : std::numeric_limits<Sample>::max();
    Sums sum{}, columns[kColumns];
    Ints<Bytes> moment_x{}, moment_y{};
    Ints<Bytes>{}.store(block.saturated);
    if (outputs.margins) {
        for (Sums& column : columns) column = Sums{};
        for (int j = 0; j < bins_j; ++j) Ints<Bytes>{}.store(block.line[j]);
    }
    block.lit = {};
    int count = 0;
    for (; lit_lines != 0; lit_lines &= lit_lines - 1) {
        const int j = __builtin_ctz(lit_lines);
        const Sample* const line = samples + j * stride;
        const auto brightest = brightest_of<Samples>(line, bins_i);
        const std::uint32_t of_bins = (1U << bins_i) - 1U, lit = lit_bits(brightest, dark) & of_bins;
        if (lit == 0) continue;  // the lit sample lies beyond the sixteen lenslets
        std::uint32_t hot = can_saturate ? lit_bits(brightest, static_cast<Sample>(levels.saturated - 1)) & of_bins : 0;
        for (; hot != 0; hot &= hot - 1) {
            for (int l = 0; l < kLanes; ++l)
                block.saturated[l] |= line[l * bins_i + __builtin_ctz(hot)] >= levels.saturated ? kSaturated : kValid;
        }
        add_lit(block.lit, j * bins_i, lit);
        LineSums<Sums> of_line{};
        gather_line<Bytes>(line, j, lit, extents, darkness, outputs, count, columns, of_line, block);
        sum = sum + of_line.mass;
        if (outputs.margins) ints<Bytes, std::uint16_t>(of_line.mass).store(block.line[j]);
        if (outputs.moments) {
            moment_x = moment_x + ints<Bytes, std::int16_t>(of_line.moment);
            moment_y = moment_y + ints<Bytes, std::uint16_t>(of_line.mass) * (2 * j - (bins_j - 1));
        }
    }
    block.count = count;
    if (outputs.margins) {
        for (int i = 0; i < bins_i; ++i) ints<Bytes, std::uint16_t>(columns[i]).store(block.column[i]);
    }
    ints<Bytes, std::uint16_t>(sum).store(block.sum);
    moment_x.store(block.moment_x);
    moment_y.store(block.moment_y);
    const auto min_sum = static_cast<std::int32_t>(std::min(levels.min_sum, 1U << 30));  // above every sum
    std::int32_t masks[kLanes];
    for (int l = 0; l < kLanes; ++l) masks[l] = (block.sum[l] < min_sum ? kDark : kValid) | block.saturated[l];
    for (int l = 0; l < kLanes; ++l) block.mask[l] = static_cast<std::uint8_t>(masks[l]);
    for (int l = 0; l < kLanes; ++l) block.inverse[l] = 1.0F / static_cast<float>(std::max(block.sum[l], 1));
    for (int l = 0; l < kLanes; ++l) block.inverse[l] = masks[l] == kValid ? block.inverse[l] : 0.0F;
}

template <int Bytes>
HORD_ALWAYS_INLINE void compute_shares(const SoaBlock& block, std::size_t stride, bool roots, float* first) {
    const auto inverse = Floats<Bytes>::load(block.inverse);
    const int count = block.count;
    for (int c = 0; c < count; ++c) {
        float* const to = first + block.bin[c] * stride;
        auto share = Ints<Bytes>::load_converted(block.mass[c]).template convert<float>() * inverse;
        if (roots) {
            float of_lanes[kLanes];
            share.store(of_lanes);
            for (int l = 0; l < kLanes; ++l) of_lanes[l] = std::sqrt(of_lanes[l]);
            share = Floats<Bytes>::load(of_lanes);
        }
        share.store(to);
    }
}

// Cumulative sums, exact integers until they are scaled.
template <int Bytes>
HORD_ALWAYS_INLINE void compute_marginals(const SoaBlock& block, const Extents& extents, std::size_t stride,
                                          float* first) {
    const auto along = [&](const std::int32_t(*sums)[kLanes], int count) __attribute__((always_inline)) {
        Ints<Bytes> passed{};
        for (int k = 0; k < count; ++k, first += stride) {
            passed = passed + Ints<Bytes>::load_converted(sums[k]);
            (passed.template convert<float>() * Floats<Bytes>::load(block.inverse)).store(first);
        }
    };
    along(block.column, extents.i - 1);
    along(block.line, extents.j - 1);
}

HORD_FOR_EACH_ISA(gather8_for, gather, std::uint8_t)
HORD_FOR_EACH_ISA(gather16_for, gather, std::uint16_t)
HORD_FOR_EACH_ISA(shares_for, compute_shares)
HORD_FOR_EACH_ISA(marginals_for, compute_marginals)

}  // namespace

SoaBlock::Kernels SoaBlock::kernels(Isa isa) {
    return {gather8_for(isa), gather16_for(isa), shares_for(isa), marginals_for(isa)};
}

}  // namespace hord::algo
