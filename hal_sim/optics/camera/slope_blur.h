// Spreads light of one slope over the slopes around it, along u and v independently.
#pragma once

#include <vector>

#include "hal_sim/optics/camera/source_area.h"

namespace hord::sim {

class SlopeBlur {
  public:
    static constexpr double kFinest = 1.0 / 3;  // bins: light is uniform over such a cell before it is blurred

    // `step` and `most_cells`: of the grids that blur() takes, and their maximum cells a side.
    // By diffraction at a lenslet's square aperture: sinc^2, `first_zero` = wavelength / pitch from the middle, in bin
    // pitches. Why: docs/notes/optics.md.
    static SlopeBlur diffraction(double first_zero, double step, int most_cells);
    // By a Gaussian of this rms, in bin pitches.
    static SlopeBlur gaussian(double rms, double step, int most_cells);

    // The finer grid that light is collected in for `grid`.
    [[nodiscard]] SlopeGrid fine(const SlopeGrid& grid) const;

    // Adds the light in the cells of fine(grid), blurred, to those of `grid`. What leaves the grid is lost.
    void blur(const SlopeGrid& grid, const double* fine, double* cells) const;

  private:
    SlopeBlur(double (&density)(double), double unit, double step, int most_cells);
    [[nodiscard]] double share(int fine_cell, int cell) const {
        return share_[static_cast<std::size_t>(fine_cell - split_ * cell + middle_)];
    }
    int split_, middle_;
    std::vector<double> share_;  // of an even fine cell's light in a cell, by split * cell's number - fine cell's
};

}  // namespace hord::sim
