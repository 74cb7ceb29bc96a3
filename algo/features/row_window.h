// Three rows of HORDs that move down a frame: all that a gradient over neighbours looks at, and small enough to stay in
// cache (270 KB at 555 lenslets of 9x9 bins, 380 KB closed up, too).
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
    // `compact`: rows that are streamed are closed up, too.
    explicit RowWindow(const Extents& extents, CloseUp compact = nullptr, Isa isa = best_isa());

    // Decodes rows first-1 .. last of the frame, those that exist, and calls visit(n) for n = first .. last-1, each as
    // soon as rows n-1, n and n+1 are here. The frame fits the extents (check_frame). `goes_on`: the call before was of
    // the rows before, of this frame.
    template <class Visit>
    void stream(const FrameView& frame, const LightLevels& levels, int first, int last, bool goes_on, Visit&& visit) {
        for (int n = goes_on ? first + 1 : std::max(first - 1, 0); n < std::min(last + 1, extents_.n); ++n) {
            decode(frame, levels, n);
            if (compact_ != nullptr) compact_row(n);
            if (n > first) visit(n - 1);
        }
        if (last == extents_.n) visit(last - 1);
    }

    // The steps of stream(), for callers with work of their own between them: decodes row n into its place; compacts
    // the decoded row n (only of a window with `compact`).
    const HordRow& decode(const FrameView& frame, const LightLevels& levels, int n) {
        HordRow& row = rows_[static_cast<std::size_t>(n % 3)];
        decode_row(frame, extents_, levels, n, row, isa_);
        return row;
    }
    void compact_row(int n) {
        compact_(row(n).hord(0).mass, row(n).sums(), extents_.bins(), closed_[static_cast<std::size_t>(n % 3)].data());
    }

    [[nodiscard]] const HordRow& row(int n) const { return rows_[static_cast<std::size_t>(n % 3)]; }
    // Of a window that closes up.
    [[nodiscard]] const SparseHord& closed(int m, int n) const {
        return closed_[static_cast<std::size_t>(n % 3)][static_cast<std::size_t>(m)];
    }

    // What a gradient at (m, n) compares, by the rules of algo/features/stencil.h. `mask` says why there is none.
    struct Neighbours {
        std::uint8_t mask = 0;
        Stencil across, down;
        int left = 0, right = 0, above = 0, below = 0;  // columns and rows of the lenslets compared
    };
    [[nodiscard]] Neighbours neighbours(int m, int n) const;

  private:
    Extents extents_;
    CloseUp compact_;
    Isa isa_;
    std::array<HordRow, 3> rows_;  // row n in place n % 3
    std::array<AlignedVector<SparseHord>, 3> closed_;
};

}  // namespace hord::algo
