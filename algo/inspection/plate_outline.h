// The outline of a flat body whose middle shows free light: what its edges enclose, as far as they are seen
// (docs/notes/inspection.md).
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/inspection/row_hull.h"

namespace hord::algo {

class PlateOutline {
  public:
    explicit PlateOutline(const Extents& extents) : extents_(extents), hull_(extents) {}  // allocates all memory

    // `state` holds outline::kPart at the lenslets of the edges. If their convex hull covers at least 1/kSmallestPart
    // of the field, and is not a narrow strip, the hull gets kPart and kInside, and all else loses kPart. A corner of
    // the field between two sides that the edges reach belongs to the hull, unless an edge runs from one side to the
    // other there. Else nothing changes. Returns whether there is such a hull.
    bool find(std::span<std::uint8_t> state);

  private:
    [[nodiscard]] bool is_plate(std::size_t lenslets) const;
    void add_corners(std::span<const std::uint8_t> state);

    Extents extents_;
    RowHull hull_;
};

}  // namespace hord::algo
