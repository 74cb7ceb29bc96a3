// Obstacles in the camera: the Fourier stop, the lenses' rims, dust. Each is a disc with one transmission inside and
// another outside. The ray's position in the disc's plane is linear in its position and slope on the measurement plane
// (docs/notes/optics.md).
#pragma once

#include <vector>

#include "hal_sim/optics/camera/source_area.h"
#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

class Obstacles {
  public:
    explicit Obstacles(const Scene& scene);

    [[nodiscard]] bool empty() const { return discs_.empty(); }

    // Transmission of a ray through (x, y) with slopes in bin pitches, in the camera's frame.
    [[nodiscard]] double transmission(double x_mm, double y_mm, double u_bins, double v_bins) const;

    // The same for all rays of a rectangle of positions and a box of slopes; -1 if an edge runs through them.
    [[nodiscard]] double transmission(double x_mm, double y_mm, double half_x_mm, double half_y_mm,
                                      const SlopeBox& box) const;

  private:
    struct Disc {
        double of_place, of_slope;  // mm a mm, mm a bin pitch
        double x, y, radius;        // mm
        double inside, outside;
    };
    std::vector<Disc> discs_;
};

}  // namespace hord::sim
