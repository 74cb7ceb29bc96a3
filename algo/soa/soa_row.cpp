#include "algo/soa/soa_row.h"

#include <algorithm>
#include <cstdlib>

#include "common/fixed.h"

namespace hord::algo {

// A block, and room for copied lines.
struct SoaRow::Work {
    SoaBlock block;
    std::uint16_t copied[kMaxBins * (kMaxBins * kLanes + SoaBlock::kReadAhead)];
};

namespace {

int blocks_of(const Extents& extents) { return (extents.m + SoaRow::kLanes - 1) / SoaRow::kLanes; }
std::size_t lenslets_of(const Extents& extents) {
    return static_cast<std::size_t>(blocks_of(extents) * SoaRow::kLanes);
}

}  // namespace

SoaRow::SoaRow(const Extents& extents, SoaUse use, Isa isa, bool moments)
    : extents_(extents),
      use_(use), outputs_{use == SoaUse::shares || use == SoaUse::roots, use == SoaUse::marginals, moments},
      blocks_(blocks_of(extents)), arrays_(use == SoaUse::sums            ? 0
                                               : use == SoaUse::marginals ? extents.i + extents.j - 2
                                                                          : extents.bins()),
      stride_(lenslets_of(extents) + 2 * kPad), values_(static_cast<std::size_t>(arrays_) * stride_),
      lit_(static_cast<std::size_t>(blocks_)), sums_(lenslets_of(extents)), moments_x_(sums_.size()),
      moments_y_(sums_.size()), mask_(sums_.size()), work_(common::make_opaque<Work>()),
      kernels_(SoaBlock::kernels(isa)) {
    if (use != SoaUse::marginals) return;
    for (Lit& lit : lit_) {
        for (int k = 0; k < arrays_; ++k) lit[static_cast<std::size_t>(k / 64)] |= std::uint64_t{1} << (k % 64);
    }
}

template <class Sample>
void SoaRow::decode_samples(const FrameView& frame, const LightLevels& levels, int n, int first_block, int last_block) {
    const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
    const auto* first = reinterpret_cast<const Sample*>(frame.data) + n * extents_.j * stride;
    const int of_a_block = kLanes * extents_.i;
    constexpr int kReadAhead = SoaBlock::kReadAhead;
    SoaBlock& work = work_->block;
    for (int block = 0; block < blocks_; ++block) {
        if (block < first_block || block > last_block) {
            clear_block(block);
            continue;
        }
        const int at = block * of_a_block;
        const Sample* samples = first + at;
        std::ptrdiff_t line_stride = stride;
        // Whole vectors are read: near the end of the lines, from a copy padded with zeros.
        if (at + of_a_block + kReadAhead > frame.width_px) {
            auto* copied = reinterpret_cast<Sample*>(work_->copied);
            line_stride = of_a_block + kReadAhead;
            const int left = std::min(frame.width_px - at, of_a_block);
            for (int j = 0; j < extents_.j; ++j) {
                std::fill(std::copy_n(samples + j * stride, left, copied + j * line_stride),
                          copied + (j + 1) * line_stride, Sample{0});
            }
            samples = copied;
        }
        if constexpr (sizeof(Sample) == 1) {
            kernels_.gather8(samples, line_stride, extents_, levels, outputs_, work);
        } else {
            kernels_.gather16(samples, line_stride, extents_, levels, outputs_, work);
        }
        store_block(block);
    }
}

void SoaRow::store_block(int block) {
    const auto m = static_cast<std::size_t>(block * kLanes);
    const SoaBlock& work = work_->block;
    for (int l = 0; l < kLanes; ++l) {
        expect_no_overflow(work.sum[l] >= 0 && static_cast<std::uint32_t>(work.sum[l]) < kSumLimit);
        expect_no_overflow(std::abs(work.moment_x[l]) <= 14 * work.sum[l] &&
                           std::abs(work.moment_y[l]) <= 14 * work.sum[l]);
    }
    std::copy_n(work.mask, kLanes, mask_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.sum, kLanes, sums_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.moment_x, kLanes, moments_x_.begin() + static_cast<std::ptrdiff_t>(m));
    std::copy_n(work.moment_y, kLanes, moments_y_.begin() + static_cast<std::ptrdiff_t>(m));
    if (use_ == SoaUse::sums) return;
    float* const first = values_.data() + kPad + m;
    if (use_ == SoaUse::marginals) return kernels_.marginals(work, extents_, stride_, first);
    darken(block, work.lit);
    kernels_.shares(work, stride_, use_ == SoaUse::roots, first);
}

// Sets the arrays to 0 that were lit in the block and are not any more.
void SoaRow::darken(int block, const Lit& still_lit) {
    Lit& before = lit_[static_cast<std::size_t>(block)];
    float* const first = values_.data() + kPad + block * kLanes;
    for (std::size_t w = 0; w < before.size(); ++w) {
        for (std::uint64_t gone = before[w] & ~still_lit[w]; gone != 0; gone &= gone - 1) {
            std::fill_n(first + (w * 64 + static_cast<std::size_t>(__builtin_ctzll(gone))) * stride_, kLanes, 0.0F);
        }
    }
    before = still_lit;
}

void SoaRow::clear_block(int block) {
    const auto m = static_cast<std::ptrdiff_t>(block) * kLanes;
    std::fill_n(mask_.begin() + m, kLanes, kDark);
    std::fill_n(sums_.begin() + m, kLanes, 0U);
    std::fill_n(moments_x_.begin() + m, kLanes, 0);
    std::fill_n(moments_y_.begin() + m, kLanes, 0);
    if (use_ == SoaUse::shares || use_ == SoaUse::roots) darken(block, {});
    if (use_ != SoaUse::marginals) return;
    for (int k = 0; k < arrays_; ++k)
        std::fill_n(values_.begin() + kPad + m + k * static_cast<std::ptrdiff_t>(stride_), kLanes, 0.0F);
}

void SoaRow::decode(const FrameView& frame, const LightLevels& levels, int n, int first, int last) {
    if (frame.bits > 8) {
        decode_samples<std::uint16_t>(frame, levels, n, first, last);
    } else {
        decode_samples<std::uint8_t>(frame, levels, n, first, last);
    }
}

}  // namespace hord::algo
