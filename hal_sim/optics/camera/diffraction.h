// Blur by diffraction at a lenslet's square aperture: light of one slope spreads over the slopes around it as sinc^2,
// wavelength / pitch from the middle to the first zero. Why: docs/notes/optics.md.
#pragma once

#include <vector>

#include "hal_sim/optics/camera/source_area.h"

namespace hord::sim {

class Diffraction {
  public:
    static constexpr double kFinest = 1.0 / 3;  // bins: light is uniform over such a cell before it is blurred

    // `first_zero`: from the pattern's middle, in bin pitches. `step` and the maximum cells a side of the grids that
    // blur() takes.
    Diffraction(double first_zero, double step, int most_cells);

    // The finer grid that light is collected in for `grid`.
    [[nodiscard]] SlopeGrid fine(const SlopeGrid& grid) const;

    // Adds the light in the cells of fine(grid), blurred, to those of `grid`. What leaves the grid is lost.
    void blur(const SlopeGrid& grid, const double* fine, double* cells) const;

  private:
    [[nodiscard]] double share(int fine_cell, int cell) const {
        return share_[static_cast<std::size_t>(fine_cell - split_ * cell + middle_)];
    }
    int split_, middle_;
    std::vector<double> share_;  // of an even fine cell's light in a cell, by split * cell's number - fine cell's
};

}  // namespace hord::sim
