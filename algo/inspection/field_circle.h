// The circle on which most of a convex outline lies, as far as the field shows it (docs/notes/inspection.md, "What the
// form explains"). The places of the outline that lie off it do not move it.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/row_hull.h"

namespace hord::algo {

class FieldCircle {
  public:
    explicit FieldCircle(const Extents& extents);  // allocates all memory

    // Fits the circle to the outline of `hull`, which is closed. False if less than two thirds of the outline
    // inside the field lie on it, to a lenslet.
    bool fit(const RowHull& hull);

    // The lenslet lies more than `depth` lenslets inside the circle.
    [[nodiscard]] bool contains(int m, int n, double depth) const {
        const double x = m - middle_m_, y = n - middle_n_, within = radius_ - depth;
        return within > 0 && x * x + y * y < within * within;
    }

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
