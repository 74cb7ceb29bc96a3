// The rectangle that a convex outline shows of itself in the field (docs/notes/inspection.md, "Plates that the field
// cuts"). Its sides that lie inside the field are those of the outline; what lies beyond the field is not known.
#pragma once

#include <array>

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

    // The outline is the rectangle but for its corners: five sixths of it inside the field lie on the rectangle's
    // sides, to a lenslet, or it lies on half of each side. A parallelogram touches two sides of its rectangle at a
    // corner only.
    [[nodiscard]] bool explains(const RowHull& hull) const;

    // By how much the cuts at the rectangle's corners differ, the longest leg less the shortest, lenslets: 0 for a
    // rectangle, and where all four corners are alike. Corners beyond the field do not count.
    [[nodiscard]] double uneven_corners(const RowHull& hull) const;

    // How far the outline of a strip stays away from the nearer of its long sides at the most, lenslets.
    [[nodiscard]] double farthest_from_long_sides(const RowHull& hull) const;

  private:
    FieldRectangle(const RowHull& hull, const Extents& extents, double angle);
    // Lengths inside the field, lenslets.
    struct Outline {
        double all = 0, on_sides = 0;
        std::array<double, 4> on_side{};  // first and last u, first and last v
    };
    [[nodiscard]] Outline outline_of(const RowHull& hull, double near) const;
    [[nodiscard]] double seen_of(bool along, double at) const;

    Extents extents_;
    double cos_, sin_;
    double first_u_, last_u_, first_v_, last_v_;  // lenslets along the turned axes: u = m cos + n sin
};

}  // namespace hord::algo
