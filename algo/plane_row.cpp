#include "algo/plane_row.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "algo/fixed.h"
#include "algo/isa_targets.h"

namespace hord::algo {

constexpr int kLanes = PlaneRow::kLanes;
constexpr int kReadAhead = 64;  // samples that may be read after a block's last
constexpr int kCacheLine = 64;  // bytes; the same samples of the next lenslet row are fetched while this one is worked on

// Sixteen lenslets. Lanes of dark or missing ones are 0.
struct PlaneRow::Block {
    std::int32_t column[kMaxBins][kLanes];  // sums over the lines, of each bin column
    std::int32_t line[kMaxBins][kLanes];    // and over the columns, of each line
    std::int32_t sum[kLanes], moment_x[kLanes], moment_y[kLanes];
    std::uint8_t saturated[kLanes], mask[kLanes];
    float inverse[kLanes];                  // 1 / sum; 0 without a HORD
    int count = 0;                          // lit bins, and their masses
    std::uint8_t bin[kMostBins];
    std::int32_t mass[kMostBins][kLanes];
    std::uint16_t copied[kMaxBins * (kMaxBins * kLanes + kReadAhead)];  // the end of the lines
};

namespace {

using Block = PlaneRow::Block;

using Bytes16 = Vector<std::uint8_t, 16>;

// Which of sixteen samples are above `dark`, as bits.
HORD_ALWAYS_INLINE std::uint32_t lit_bits(const Bytes16& samples, std::uint8_t dark) {
    const auto above = samples > Bytes16{} + dark;  // bytes of all ones or none
    std::uint64_t halves[2];
    std::memcpy(halves, &above, sizeof halves);
    const auto eight = [](std::uint64_t bytes) { return ((bytes & 0x8040201008040201U) * 0x0101010101010101U) >> 56; };
    return static_cast<std::uint32_t>(eight(halves[0]) | eight(halves[1]) << 8);
}
HORD_ALWAYS_INLINE std::uint32_t lit_bits(const Vector<std::uint16_t, 32>& samples, std::uint16_t dark) {
    std::uint32_t bits = 0;
    for (int i = 0; i < kLanes; ++i) bits |= std::uint32_t{samples[i] > dark} << i;
    return bits;
}

// Whether one of `count` samples, or of those that follow in the last vector, is above `dark`.
template <int Bytes, class Sample>
HORD_ALWAYS_INLINE bool any_above(const Sample* samples, int count, Sample dark) {
    using Wide = Vector<Sample, Bytes>;
    auto most = load<Wide>(samples);
    for (int k = Bytes / static_cast<int>(sizeof(Sample)); k < count; k += Bytes / static_cast<int>(sizeof(Sample))) {
        const auto more = load<Wide>(samples + k);
        most = more > most ? more : most;
    }
    const auto above = most > Wide{} + dark;
    std::uint64_t parts[Bytes / 8], any = 0;
    std::memcpy(parts, &above, sizeof parts);
    for (const std::uint64_t part : parts) any |= part;
    return any != 0;
}

// Eight neighbouring samples of each of sixteen lenslets, `apart` samples from one to the next, as eight vectors of sixteen: four perfect
// shuffles of the 128 bytes.
HORD_ALWAYS_INLINE void transpose(const std::uint8_t* samples, int apart, Bytes16 (&out)[8]) {
    Bytes16 v[8];
    for (int p = 0; p < 8; ++p) {
        std::uint64_t two[2];
        std::memcpy(&two[0], samples + 2 * p * apart, 8);
        std::memcpy(&two[1], samples + (2 * p + 1) * apart, 8);
        std::memcpy(&v[p], two, sizeof two);
    }
    for (int shuffle = 0; shuffle < 4; ++shuffle) {
        for (int k = 0; k < 4; ++k) {
            out[2 * k] = __builtin_shufflevector(v[k], v[k + 4], 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
            out[2 * k + 1] = __builtin_shufflevector(v[k], v[k + 4], 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
        }
        std::copy_n(out, 8, v);
    }
}

// One lit bin of a line: its sixteen samples become masses, and are added up.
template <int Bytes>
HORD_ALWAYS_INLINE void add_bin(std::int32_t dark, std::int32_t* mass, std::int32_t* column, std::int32_t* line) {
    using Ints = Vector<std::int32_t, Bytes>;
    const Ints dark_all = Ints{} + dark;
    for (int l = 0; l < kLanes; l += Bytes / 4) {
        auto m = load<Ints>(mass + l);
        m = (m > dark_all ? m : dark_all) - dark_all;
        store(m, mass + l);
        store(load<Ints>(column + l) + m, column + l);
        store(load<Ints>(line + l) + m, line + l);
    }
}

template <int Bytes, int kCount>
HORD_ALWAYS_INLINE void clear(std::int32_t (&lanes)[kCount][kLanes], int count) {
    for (int k = 0; k < count; ++k) {
        for (int l = 0; l < kLanes; l += Bytes / 4) store(Vector<std::int32_t, Bytes>{}, lanes[k] + l);
    }
}

// Finds the bins that are lit in any of the sixteen lenslets, gathers those, and adds them up.
template <int Bytes, class Sample>
HORD_ALWAYS_INLINE void gather(const Sample* samples, std::ptrdiff_t stride, const Extents& extents, const LightLevels& levels, bool keep, Block& block) {
    const int bins_i = extents.i, bins_j = extents.j;
    const auto dark = static_cast<std::int32_t>(levels.dark), full = static_cast<std::int32_t>(levels.saturated);
    clear<Bytes>(block.column, bins_i);
    clear<Bytes>(block.line, bins_j);
    for (int l = 0; l < kLanes; ++l) block.saturated[l] = 0;
    int count = 0;
    for (int j = 0; j < bins_j; ++j, samples += stride) {
        // The brightest of the sixteen lenslets, bin by bin; what lies beyond bin I is another lenslet's.
        using Samples = Vector<Sample, kLanes * sizeof(Sample)>;
        for (int ahead = 0; ahead < kLanes * bins_i * static_cast<int>(sizeof(Sample)); ahead += kCacheLine) {
            __builtin_prefetch(reinterpret_cast<const char*>(samples + bins_j * stride) + ahead);
        }
        if (!any_above<Bytes>(samples, kLanes * bins_i, static_cast<Sample>(dark))) continue;
        const Sample* lenslet = samples;
        auto brightest = load<Samples>(lenslet);
        for (int l = 1; l < kLanes; ++l) {
            lenslet += bins_i;
            const auto more = load<Samples>(lenslet);
            brightest = more > brightest ? more : brightest;
        }
        const std::uint32_t of_bins = (1U << bins_i) - 1U;
        std::uint32_t lit = lit_bits(brightest, static_cast<Sample>(dark)) & of_bins;
        std::uint32_t hot = full <= std::numeric_limits<Sample>::max() ? lit_bits(brightest, static_cast<Sample>(full - 1)) & of_bins : 0;
        for (; hot != 0; hot &= hot - 1) {
            for (int l = 0; l < kLanes; ++l) block.saturated[l] |= samples[l * bins_i + __builtin_ctz(hot)] >= full ? kSaturated : kValid;
        }
        while (lit != 0) {
            const int first = __builtin_ctz(lit);
            if constexpr (sizeof(Sample) == 1) {
                // Lit bins lie close together: one transposition of eight mostly brings all of a line.
                Bytes16 eight[8];
                transpose(samples + first, bins_i, eight);
                std::uint8_t sixteen[8][kLanes];
                for (int k = 0; k < 8; ++k) store(eight[k], sixteen[k]);
                for (std::uint32_t now = (lit >> first) & 0xFFU; now != 0; now &= now - 1) {
                    const int i = __builtin_ctz(now);
                    for (int l = 0; l < kLanes; ++l) block.mass[count][l] = sixteen[i][l];
                    add_bin<Bytes>(dark, block.mass[count], block.column[first + i], block.line[j]);
                    block.bin[count] = static_cast<std::uint8_t>(j * bins_i + first + i);
                    count += keep ? 1 : 0;
                }
                lit &= ~(0xFFU << first);
            } else {
                for (int l = 0; l < kLanes; ++l) block.mass[count][l] = samples[l * bins_i + first];
                add_bin<Bytes>(dark, block.mass[count], block.column[first], block.line[j]);
                block.bin[count] = static_cast<std::uint8_t>(j * bins_i + first);
                count += keep ? 1 : 0;
                lit &= lit - 1;
            }
        }
    }
    block.count = count;
    using Ints = Vector<std::int32_t, Bytes>;
    for (int l = 0; l < kLanes; l += Bytes / 4) {
        Ints sum{}, moment_x{}, moment_y{};
        for (int i = 0; i < bins_i; ++i) {
            const auto column = load<Ints>(block.column[i] + l);
            sum += column;
            moment_x += column * (2 * i - (bins_i - 1));
        }
        for (int j = 0; j < bins_j; ++j) moment_y += load<Ints>(block.line[j] + l) * (2 * j - (bins_j - 1));
        store(sum, block.sum + l);
        store(moment_x, block.moment_x + l);
        store(moment_y, block.moment_y + l);
    }
    const auto min_sum = static_cast<std::int32_t>(std::min(levels.min_sum, 1U << 30));  // above every sum
    std::int32_t masks[kLanes];
    for (int l = 0; l < kLanes; ++l) masks[l] = (block.sum[l] < min_sum ? kDark : kValid) | block.saturated[l];
    for (int l = 0; l < kLanes; ++l) block.mask[l] = static_cast<std::uint8_t>(masks[l]);
    for (int l = 0; l < kLanes; ++l) block.inverse[l] = 1.0F / static_cast<float>(std::max(block.sum[l], 1));
    for (int l = 0; l < kLanes; ++l) block.inverse[l] = masks[l] == kValid ? block.inverse[l] : 0.0F;
}

template <int Bytes>
HORD_ALWAYS_INLINE void shares(const Block& block, std::size_t stride, bool roots, float* first) {
    for (int c = 0; c < block.count; ++c) {
        float* const to = first + block.bin[c] * stride;
        if (roots) {
            for (int l = 0; l < kLanes; ++l) to[l] = std::sqrt(static_cast<float>(block.mass[c][l]) * block.inverse[l]);
        } else {
            for (int l = 0; l < kLanes; ++l) to[l] = static_cast<float>(block.mass[c][l]) * block.inverse[l];
        }
    }
}

// Cumulative sums are integers until they are scaled.
template <int Bytes>
HORD_ALWAYS_INLINE void marginals(const Block& block, const Extents& extents, std::size_t stride, float* first) {
    std::int32_t passed[kLanes] = {};
    for (int i = 0; i + 1 < extents.i; ++i, first += stride) {
        for (int l = 0; l < kLanes; ++l) passed[l] += block.column[i][l];
        for (int l = 0; l < kLanes; ++l) first[l] = static_cast<float>(passed[l]) * block.inverse[l];
    }
    for (int l = 0; l < kLanes; ++l) passed[l] = 0;
    for (int j = 0; j + 1 < extents.j; ++j, first += stride) {
        for (int l = 0; l < kLanes; ++l) passed[l] += block.line[j][l];
        for (int l = 0; l < kLanes; ++l) first[l] = static_cast<float>(passed[l]) * block.inverse[l];
    }
}

HORD_FOR_EACH_ISA(gather8, void, gather,
                  (const std::uint8_t* samples, std::ptrdiff_t stride, const Extents& extents, const LightLevels& levels, bool keep, Block& block),
                  (samples, stride, extents, levels, keep, block))
HORD_FOR_EACH_ISA(gather16, void, gather,
                  (const std::uint16_t* samples, std::ptrdiff_t stride, const Extents& extents, const LightLevels& levels, bool keep, Block& block),
                  (samples, stride, extents, levels, keep, block))
HORD_FOR_EACH_ISA(shares_for, void, shares, (const Block& block, std::size_t stride, bool roots, float* first), (block, stride, roots, first))
HORD_FOR_EACH_ISA(marginals_for, void, marginals, (const Block& block, const Extents& extents, std::size_t stride, float* first),
                  (block, extents, stride, first))

int blocks_of(const Extents& extents) { return (extents.m + kLanes - 1) / kLanes; }
std::size_t lenslets_of(const Extents& extents) { return static_cast<std::size_t>(blocks_of(extents) * kLanes); }

}  // namespace

PlaneRow::PlaneRow(const Extents& extents, PlaneUse use, Isa isa)
    : extents_(extents), use_(use), blocks_(blocks_of(extents)),
      planes_(use == PlaneUse::sums ? 0 : use == PlaneUse::marginals ? extents.i + extents.j - 2 : extents.bins()),
      stride_(lenslets_of(extents) + 2 * kPad), planes_of_(static_cast<std::size_t>(planes_) * stride_), lit_(static_cast<std::size_t>(blocks_)),
      sums_(lenslets_of(extents)), moments_x_(sums_.size()), moments_y_(sums_.size()), mask_(sums_.size()), work_(std::make_unique<Block>()), gather8_(gather8(isa)),
      gather16_(gather16(isa)), shares_(shares_for(isa)), marginals_(marginals_for(isa)) {
    if (use != PlaneUse::marginals) return;
    for (Lit& lit : lit_) {
        for (int k = 0; k < planes_; ++k) lit[static_cast<std::size_t>(k / 64)] |= std::uint64_t{1} << (k % 64);
    }
}

PlaneRow::PlaneRow(PlaneRow&&) noexcept = default;
PlaneRow::~PlaneRow() = default;

template <class Sample>
void PlaneRow::decode_samples(const FrameView& frame, const LightLevels& levels, int n) {
    const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
    const auto* first = reinterpret_cast<const Sample*>(frame.data) + n * extents_.j * stride;
    const int of_a_block = kLanes * extents_.i;
    const bool keep = use_ == PlaneUse::shares || use_ == PlaneUse::roots;
    Block& work = *work_;
    for (int block = 0; block < blocks_; ++block) {
        const int at = block * of_a_block;
        const Sample* samples = first + at;
        std::ptrdiff_t line_stride = stride;
        // Whole vectors are read: near the lines' end, from a copy with darkness behind it.
        if (at + of_a_block + kReadAhead > frame.width_px) {
            auto* copied = reinterpret_cast<Sample*>(work.copied);
            line_stride = of_a_block + kReadAhead;
            const int left = std::min(frame.width_px - at, of_a_block);
            for (int j = 0; j < extents_.j; ++j) {
                std::fill(std::copy_n(samples + j * stride, left, copied + j * line_stride), copied + (j + 1) * line_stride, Sample{0});
            }
            samples = copied;
        }
        if constexpr (sizeof(Sample) == 1) {
            gather8_(samples, line_stride, extents_, levels, keep, work);
        } else {
            gather16_(samples, line_stride, extents_, levels, keep, work);
        }
        store_block(block);
    }
}

void PlaneRow::store_block(int block) {
    const auto m = static_cast<std::size_t>(block * kLanes);
    Block& work = *work_;
    for (int l = 0; l < kLanes; ++l) {
        expect_no_overflow(work.sum[l] >= 0 && static_cast<std::uint32_t>(work.sum[l]) < kSumLimit);
        expect_no_overflow(std::abs(work.moment_x[l]) <= 14 * work.sum[l] && std::abs(work.moment_y[l]) <= 14 * work.sum[l]);
    }
    std::copy_n(work.mask, kLanes, mask_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.sum, kLanes, sums_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.moment_x, kLanes, moments_x_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.moment_y, kLanes, moments_y_.begin() + static_cast<std::ptrdiff_t>(m));
    float* const first = planes_of_.data() + kPad + m;
    if (use_ == PlaneUse::marginals) return marginals_(work, extents_, stride_, first);
    if (use_ == PlaneUse::sums) return;
    Lit now{};
    for (int c = 0; c < work.count; ++c) now[work.bin[c] / 64U] |= std::uint64_t{1} << (work.bin[c] % 64U);
    Lit& before = lit_[static_cast<std::size_t>(block)];
    for (std::size_t w = 0; w < now.size(); ++w) {
        for (std::uint64_t gone = before[w] & ~now[w]; gone != 0; gone &= gone - 1) {
            std::fill_n(first + (w * 64 + static_cast<std::size_t>(__builtin_ctzll(gone))) * stride_, kLanes, 0.0F);
        }
    }
    before = now;
    shares_(work, stride_, use_ == PlaneUse::roots, first);
}

void PlaneRow::decode(const FrameView& frame, const LightLevels& levels, int n) {
    if (frame.bits > 8) {
        decode_samples<std::uint16_t>(frame, levels, n);
    } else {
        decode_samples<std::uint8_t>(frame, levels, n);
    }
}

void PlaneRow::take(std::span<const Hord> row) {
    constexpr LightLevels kAsTheyAre{0, 1, 1U << 17};
    const int of_a_line = kLanes * extents_.i + kReadAhead;
    Block& work = *work_;
    std::uint16_t* const samples = work.copied;
    for (int block = 0; block < blocks_; ++block) {
        std::fill_n(samples, extents_.j * of_a_line, std::uint16_t{0});
        for (int l = 0; l < std::min(kLanes, extents_.m - block * kLanes); ++l) {
            const Hord& hord = row[static_cast<std::size_t>(block * kLanes + l)];
            if (hord.sum == 0) continue;
            for (int j = 0; j < extents_.j; ++j) std::copy_n(hord.mass + j * extents_.i, extents_.i, samples + j * of_a_line + l * extents_.i);
        }
        gather16_(samples, of_a_line, extents_, kAsTheyAre, use_ == PlaneUse::shares || use_ == PlaneUse::roots, work);
        store_block(block);
    }
}

}  // namespace hord::algo
