// Three rows of HORDs that move down a frame: all that a gradient over neighbours needs, and small enough for the cache
// (270 KB at 555 lenslets of 9x9 bins, 380 KB with compacted HORDs).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "algo/emd/sparse_hord.h"
#include "algo/features/stencil.h"
#include "algo/frame/decode.h"

namespace hord::algo {

class RowWindow {
  public:
    // `compact`: stream() also compacts the rows; nullptr: it does not.
    explicit RowWindow(const Extents& extents, CompactFunction compact = nullptr, Isa isa = best_isa());

    // Decodes rows first-1 .. last of the frame, those that exist, and calls visit(n) for n = first .. last-1, each as
    // soon as rows n-1, n and n+1 are loaded. The frame fits the extents (check_frame). `goes_on`: the previous call
    // streamed the previous rows of the same frame.
    template <class Visit>
    void stream(const FrameView& frame, const LightLevels& levels, int first, int last, bool goes_on, Visit&& visit) {
        for (int n = goes_on ? first + 1 : std::max(first - 1, 0); n < std::min(last + 1, extents_.n); ++n) {
            decode(frame, levels, n);
            if (compact_ != nullptr) compact_row(n);
            if (n > first) visit(n - 1);
        }
        if (last == extents_.n) visit(last - 1);
    }

    // The steps of stream(), for callers with work of their own between them: decodes row n, which is row `from` of the
    // frame, into its place; compacts the decoded row n (only of a window with `compact`).
    const HordRow& decode(const FrameView& frame, const LightLevels& levels, int n) {
        return decode(frame, levels, n, n);
    }
    const HordRow& decode(const FrameView& frame, const LightLevels& levels, int n, int from) {
        HordRow& row = rows_[static_cast<std::size_t>(n % 3)];
        decode_row(frame, extents_, levels, from, row, isa_);
        return row;
    }
    void compact_row(int n) {
        compact_(row(n).hord(0).mass, row(n).sums(), extents_.bins(), sparse_[static_cast<std::size_t>(n % 3)].data());
    }

    [[nodiscard]] const HordRow& row(int n) const { return rows_[static_cast<std::size_t>(n % 3)]; }
    // Only with `compact`.
    [[nodiscard]] const SparseHord& sparse(int m, int n) const {
        return sparse_[static_cast<std::size_t>(n % 3)][static_cast<std::size_t>(m)];
    }

    // The lenslets that a gradient at (m, n) compares (algo/features/stencil.h). `mask`: MaskBits, why there is none.
    struct Neighbours {
        std::uint8_t mask = 0;
        Stencil across, down;
        int left = 0, right = 0, above = 0, below = 0;  // columns and rows of the lenslets compared
    };
    [[nodiscard]] Neighbours neighbours(int m, int n) const;

  private:
    Extents extents_;
    CompactFunction compact_;
    Isa isa_;
    std::array<HordRow, 3> rows_;  // row n in place n % 3
    std::array<AlignedVector<SparseHord>, 3> sparse_;
};

}  // namespace hord::algo
