// The finders of a frame's lenslets, one for every size that they have.
#pragma once

#include <cstddef>
#include <deque>
#include <utility>

#include "algo/frame/lenslet_grid.h"
#include "calib/lattice/centres.h"

namespace hord::calib {

// What finds centres where lenslets have a given size: distortion scales them, and a profile learned in the middle of
// the frame does not fit lenslets that are smaller or larger.
class LocalFinders {
  public:
    explicit LocalFinders(CentreFinder middle) { add(1, std::move(middle)); }
    void add(double scale, CentreFinder finder) { finders_.push_back({scale, std::move(finder)}); }
    // `scale`: of the local pitch, over that in the middle.
    [[nodiscard]] const CentreFinder& at(double scale) const { return nearest(scale).finder; }
    [[nodiscard]] double nearest_scale(double scale) const { return nearest(scale).scale; }
    [[nodiscard]] const CentreFinder& middle() const { return finders_.front().finder; }
    [[nodiscard]] std::size_t count() const { return finders_.size(); }

  private:
    struct Local {
        double scale;
        CentreFinder finder;
    };
    [[nodiscard]] const Local& nearest(double scale) const;
    std::deque<Local> finders_;
};

// The finder for lenslets of the size of (m, n).
const CentreFinder& finder_for(const LocalFinders& finders, const algo::LensletGrid& grid, double pitch, int m, int n);

}  // namespace hord::calib
