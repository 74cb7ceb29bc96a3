// The circle on which most of a convex outline lies, as far as the field shows it (docs/notes/inspection.md, "What the
// form explains"). The places of the outline that lie off it do not move it.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/row_hull.h"

namespace hord::algo {

class FieldCircle {
  public:
    explicit FieldCircle(const Extents& extents);  // allocates all memory

    // Fits the circle to the outline of `hull`, which is closed. False if less than kOnCircle of the outline inside the
    // field lies on it, to a lenslet.
    bool fit(const RowHull& hull);

    // Of a lenslet, from the circle inwards, lenslets.
    [[nodiscard]] double depth(int m, int n) const { return radius_ - std::hypot(m - middle_m_, n - middle_n_); }

  private:
    void collect(const RowHull& hull);
    bool solve(double farthest);
    [[nodiscard]] double distance(std::size_t k) const;  // of a place from the circle, lenslets

    Extents extents_;
    double middle_m_ = 0, middle_n_ = 0, radius_ = 0;  // lenslets
    std::vector<std::int32_t> m_, n_;                  // places of the outline
    std::vector<double> distances_, sorted_;
};

}  // namespace hord::algo
