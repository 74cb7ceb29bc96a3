#include "algo/features/row_window.h"

namespace hord::algo {

RowWindow::RowWindow(const Extents& extents, CompactFunction compact, Isa isa)
    : extents_(extents), compact_(compact), isa_(isa), rows_{HordRow(extents), HordRow(extents), HordRow(extents)} {
    if (compact == nullptr) return;
    for (auto& row : sparse_) row.resize(static_cast<std::size_t>(extents.m));
}

RowWindow::Neighbours RowWindow::neighbours(int m, int n) const {
    Neighbours at;
    at.mask = row(n).mask()[static_cast<std::size_t>(m)];
    if (n == 0 || n == extents_.n - 1 || m == 0 || m == extents_.m - 1) {
        at.mask |= kBorder;
        return at;
    }
    if ((at.mask & kNoHord) != 0) return at;
    at.across = stencil(row(n).has_hord(m - 1), row(n).has_hord(m + 1));
    at.down = stencil(row(n - 1).has_hord(m), row(n + 1).has_hord(m));
    if (!at.across.valid() || !at.down.valid()) {
        at.mask |= kBorder;
        return at;
    }
    at.left = m + at.across.before;
    at.right = m + at.across.after;
    at.above = n + at.down.before;
    at.below = n + at.down.after;
    return at;
}

}  // namespace hord::algo
