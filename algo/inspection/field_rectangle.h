// The rectangle that a convex outline shows of itself in the field (docs/notes/inspection.md, "Plates that the field
// cuts"). Its sides that lie inside the field are those of the outline; what lies beyond the field is not known.
#pragma once

#include "algo/frame/extents.h"
#include "algo/inspection/row_hull.h"

namespace hord::algo {

class FieldRectangle {
  public:
    // About `hull`, turned so that most of its outline lies on the rectangle's sides. `hull` is closed and has a row.
    static FieldRectangle about(const RowHull& hull, const Extents& extents);

    [[nodiscard]] bool contains(int m, int n) const;

    // Both ends lie at the field's border, and both long sides are seen inside it, each over more than `share` of the
    // rectangle's width: a strip.
    [[nodiscard]] bool is_strip(double share) const;

  private:
    FieldRectangle(const RowHull& hull, const Extents& extents, double angle);
    [[nodiscard]] double outline_on_sides(const RowHull& hull, double near) const;
    [[nodiscard]] double seen_of(bool along, double at) const;

    Extents extents_;
    double cos_, sin_;
    double first_u_, last_u_, first_v_, last_v_;  // lenslets along the turned axes: u = m cos + n sin
};

}  // namespace hord::algo
